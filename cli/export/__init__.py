"""`traverse export`."""
