"""`traverse identify`."""
