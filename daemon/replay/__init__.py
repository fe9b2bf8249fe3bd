"""Replay of a recording through the measurement path, and comparison of results."""
