"""The Python client and the operator's page."""
