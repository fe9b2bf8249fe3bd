"""Measurement service of one arm."""
