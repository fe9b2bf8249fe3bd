"""Points of an arm in order: reordering, gap filling, cursor."""
