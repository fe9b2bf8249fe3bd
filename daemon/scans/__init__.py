"""Scans: plan, selection of points, messages."""
