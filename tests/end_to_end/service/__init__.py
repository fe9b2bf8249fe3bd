"""Start, stop, supervision and recordings of the real daemon."""
