"""Points and scans as files for other software."""
