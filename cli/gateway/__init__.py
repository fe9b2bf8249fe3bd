"""`traverse gateway`."""
