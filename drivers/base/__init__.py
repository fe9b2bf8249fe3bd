"""Base of all drivers: reader thread, delivered values, delivery queue."""
