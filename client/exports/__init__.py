"""Points and scans as files that other software reads."""
