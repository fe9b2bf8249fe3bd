"""Which further poses would help most."""
