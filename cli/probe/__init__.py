"""`traverse probe`."""
