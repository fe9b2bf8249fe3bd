"""Tests: points."""
