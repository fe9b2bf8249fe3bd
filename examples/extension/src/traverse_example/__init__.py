"""A driver, a format, an effect and a gateway for Traverse."""
