"""Many arms into one broker, read by a group of consumers."""
