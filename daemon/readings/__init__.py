"""What the readings of encoders show of these: frozen, repeated and coarse counts."""
