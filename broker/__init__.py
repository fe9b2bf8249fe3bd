"""Shared code of MQTT clients: addresses, credentials, packets, and reasons in words.

Knows nothing of arms.
"""
