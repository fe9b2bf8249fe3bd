"""How often acceptance is wrong."""
