"""What all drivers share: the reader thread, delivered values, the delivery queue."""
