"""Certificates: values, page, PDF, and checking them."""
