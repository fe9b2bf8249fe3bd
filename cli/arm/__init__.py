"""`traverse arm`."""
