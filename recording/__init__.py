"""MCAP files: write, read, cut."""
