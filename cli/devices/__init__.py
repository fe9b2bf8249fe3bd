"""`traverse amt21`, `board`, `can`, `microscribe`: encoders and arms on their lines."""
