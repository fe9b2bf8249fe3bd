"""Checks that need a kernel of their own; `make test-vm` runs them in a guest."""
