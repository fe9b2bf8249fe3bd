"""Arm files."""
