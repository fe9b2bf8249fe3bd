"""Base classes of effects, and the inputs of their computation."""
