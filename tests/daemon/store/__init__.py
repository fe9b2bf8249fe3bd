"""Tests: points and scan blocks on disk."""
