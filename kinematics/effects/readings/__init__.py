"""Effects that change a joint's reading."""
