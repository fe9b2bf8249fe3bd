"""Tests: points in order."""
