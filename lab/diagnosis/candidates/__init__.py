"""Everything that might be missing, as columns, and its scores."""
