"""Results of an adjustment, as values and files."""
