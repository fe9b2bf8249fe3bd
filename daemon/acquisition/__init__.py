"""Devices and their readings: state, resampling to common instants, warnings."""
