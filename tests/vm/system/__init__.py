"""Checks of the package on Debian with systemd; `make test-vm` runs them in a guest."""
