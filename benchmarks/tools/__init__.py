"""Shared parts of benchmarks: programs, networks, turns, sockets."""
