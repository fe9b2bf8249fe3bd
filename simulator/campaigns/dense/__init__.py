"""Dense scans: `python -m simulator.campaigns.dense SPEC.toml --out DIR`."""
