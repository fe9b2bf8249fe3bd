"""What a diagnosis works with: fits, equations, candidates, results."""
