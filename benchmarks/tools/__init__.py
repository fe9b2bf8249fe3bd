"""What benchmarks share: programs, networks, turns, sockets."""
