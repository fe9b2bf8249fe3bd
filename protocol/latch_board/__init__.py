"""The latching controller board: requests to bytes, bytes to values."""
