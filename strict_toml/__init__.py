"""Strict TOML: every mistake of a file at once, and files written whole."""
