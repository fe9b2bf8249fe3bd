"""Tests: connection of a client."""
