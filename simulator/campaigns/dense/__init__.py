"""Dense scans of a simulated arm."""
