"""Campaigns with hidden effects for blind tests."""
