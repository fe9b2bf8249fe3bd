"""Tests: poses."""
