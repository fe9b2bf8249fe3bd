"""The whole measurement path from memory: bytes of a board to payloads for a broker.

Neither a port nor a broker is in it. `line.py` has the bytes, `whole.py` the path with
the classes that the daemon uses, `plain_loop.py` a first try without Traverse.
"""
