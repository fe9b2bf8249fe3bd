"""Points, scans and commands against the truth of the simulator."""
