"""Effects of the contact and of the touched surface."""
