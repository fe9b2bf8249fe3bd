"""Events, latencies and metrics of the daemon."""
