"""Tests: commands on stored and sent points."""
