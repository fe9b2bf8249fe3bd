"""The least-squares solution: iterations, rank, outliers, variance components."""
