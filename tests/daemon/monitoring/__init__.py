"""Tests: events, latencies, metrics."""
