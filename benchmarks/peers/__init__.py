"""Other libraries on the same arm, each as its own documentation would have it.

They are installed into an environment of their own (`benchmarks/peers.txt`), which
Traverse itself never uses.
"""
