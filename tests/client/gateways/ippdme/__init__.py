"""Tests of the I++ DME server."""
