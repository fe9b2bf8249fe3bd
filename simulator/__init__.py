"""A virtual arm with its own physics, speaking the bytes of real devices."""
