"""What displays show."""
