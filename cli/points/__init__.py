"""`traverse points`."""
