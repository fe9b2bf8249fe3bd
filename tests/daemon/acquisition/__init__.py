"""Tests: devices and resampling."""
