"""A device's clock and sequence numbers, mapped to the host's."""
