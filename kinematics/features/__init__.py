"""Features of a part with the uncertainty that their points' shared arm leaves them."""
