"""Devices, their readings, and resampling to common instants."""
