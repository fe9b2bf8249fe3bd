"""Tests of the harness of trials."""
