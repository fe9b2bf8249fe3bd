"""Predicted errors of alignments against true ones."""
