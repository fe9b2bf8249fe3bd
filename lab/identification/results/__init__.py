"""What an adjustment says, as values and files."""
