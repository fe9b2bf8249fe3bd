"""Replay of a recording through the measuring path, and comparison of results."""
