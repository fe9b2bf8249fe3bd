"""`traverse replay`."""
