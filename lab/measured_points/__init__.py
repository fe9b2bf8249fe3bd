"""Touched places by artefact, from campaigns, recordings and exported points."""
