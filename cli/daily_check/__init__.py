"""`traverse daily-check`: the daily check."""
