"""Drivers, clocks and decoders."""
