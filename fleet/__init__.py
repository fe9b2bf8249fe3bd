"""What many arms publish, kept in one place."""
