"""Trials: cases drawn from seeds, run on all cores or a cluster, judged in tables."""
