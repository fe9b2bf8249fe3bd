"""Delivery over the broker: outages, encodings, TLS, hostile clients."""
