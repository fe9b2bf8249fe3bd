"""Arms that others built and measured: identified, and judged by poses kept aside."""
