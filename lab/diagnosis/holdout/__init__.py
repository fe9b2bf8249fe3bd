"""Poses kept aside, and models compared on them."""
