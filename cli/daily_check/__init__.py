"""`traverse interim`: the daily check."""
