"""A server of I++ DME 1.4.3, for metrology software that drives coordinate machines."""
