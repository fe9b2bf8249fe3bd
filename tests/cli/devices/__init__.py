"""Tests: commands for devices."""
