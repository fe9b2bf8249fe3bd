"""Base of all drivers: the reader thread, delivered values, the delivery queue."""
