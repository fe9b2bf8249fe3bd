"""Bytes to values and back, on every wire: no ports, no clock, no log."""
