"""`traverse microscribe`."""
