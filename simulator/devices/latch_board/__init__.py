"""A simulated latching controller board."""
