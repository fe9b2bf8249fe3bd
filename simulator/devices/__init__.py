"""Simulated devices, one file each: their own bytes, joined to the virtual arm."""
