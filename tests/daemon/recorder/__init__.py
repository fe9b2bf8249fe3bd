"""Tests: recorder."""
