"""From counts of all joints to corrected, flagged poses of the probe."""
