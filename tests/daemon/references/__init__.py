"""Tests: references."""
