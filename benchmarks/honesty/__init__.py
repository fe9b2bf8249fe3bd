"""Proof of honesty: worlds in virtual time, in which no unmarked number may be wrong.

Drivers, device clocks and the measuring path are the daemon's; the arm, the devices and
their bytes are the simulator's; only ports and time are virtual.
"""
