"""Recorder of all steps of a measurement: flight recorder and manual recordings."""
