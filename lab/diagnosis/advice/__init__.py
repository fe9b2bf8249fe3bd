"""What would have been seen, and which experiment would tell effects apart."""
