"""Effects of the contact and of what is touched."""
