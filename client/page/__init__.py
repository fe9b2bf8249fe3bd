"""The operator's page: a client like any other, in a browser."""
