"""Simulated CANopen encoders on a CAN bus."""
