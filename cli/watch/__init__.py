"""`traverse watch`."""
