"""Tests: scans."""
