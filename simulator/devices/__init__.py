"""Simulated devices, one file each; `kinds.py` lists them.

To add one: a child of `DeviceTable` (its keys), a class made as `Class(table,
mounting)` that is a `SimulatedDevice`, a line in `kinds.py`. For a device on serial
lines take `SerialTable` and `SerialDevice` and define the meaning of a byte. Bytes are
written from the protocol's facts and never with the code that decodes them.
"""
