"""A device's clock and sequence numbers, mapped to those of the host."""
