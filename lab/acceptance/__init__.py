"""Standards' figures, alignment reports and charts."""
