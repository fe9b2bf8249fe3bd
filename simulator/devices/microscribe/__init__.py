"""A simulated MicroScribe arm."""
