"""Cost and robustness of the daemon."""
