"""Arm files: strict reading, and writing that keeps every number bit for bit."""
