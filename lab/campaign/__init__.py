"""Campaigns: what was measured for identification, as arrays."""
