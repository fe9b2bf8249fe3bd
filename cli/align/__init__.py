"""`traverse align`."""
