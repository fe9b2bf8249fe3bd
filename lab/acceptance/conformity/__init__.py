"""Figures, limits, uncertainties and decisions."""
