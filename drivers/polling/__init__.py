"""Drivers whose encoders are read one after the other."""
