"""Physical effects beyond the geometry, one file each."""
