"""Configuration file of the daemon: strict tables, one model each."""
