"""Time and memory of the adjustment."""
