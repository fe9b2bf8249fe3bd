"""What all effects have in common, and what they are computed from."""
