"""Whole arms with encoders of several makers, and faults of their lines."""
