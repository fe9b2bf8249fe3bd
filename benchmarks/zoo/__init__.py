"""Robot descriptions of strangers: read right, or refused with a reason that holds."""
