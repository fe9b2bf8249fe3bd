"""Minimal detectable sizes, and experiments that separate effects."""
