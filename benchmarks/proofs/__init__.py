"""Slow statistical proofs of the identification, over hundreds of simulated seeds."""
