"""The test procedures of the standards."""
