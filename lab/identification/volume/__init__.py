"""Uncertainty of distances over the working volume of an identified arm."""
