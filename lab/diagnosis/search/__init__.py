"""Which candidates are added, how they are named, and what is taken back."""
