"""`traverse amt21`, `can`, `microscribe`: encoders and arms on their lines."""
