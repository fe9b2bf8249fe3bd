"""Bytes of a MicroScribe: packets, and the session around them."""
