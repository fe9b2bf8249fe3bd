"""The Helmert transformation: adjusted, tested, and its errors in a volume."""
