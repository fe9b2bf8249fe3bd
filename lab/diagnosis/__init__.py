"""Detect, name and adapt what the model of the arm lacks."""
