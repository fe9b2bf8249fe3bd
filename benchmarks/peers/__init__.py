"""Other libraries on the same arm, used as documented.

They are installed into an environment of their own (`benchmarks/peers.txt`), which
Traverse itself never uses.
"""
