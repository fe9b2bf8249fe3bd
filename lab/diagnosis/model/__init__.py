"""Model of a diagnosis: fits, equations, candidates, results."""
