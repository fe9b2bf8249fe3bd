"""Drivers of devices that have inputs and no encoders."""
