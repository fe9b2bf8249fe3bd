"""A store of the messages of many arms."""
