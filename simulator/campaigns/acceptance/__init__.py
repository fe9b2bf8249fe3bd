"""Simulated acceptance tests."""
