"""`traverse collect`."""
