"""Tests: connection to the broker."""
