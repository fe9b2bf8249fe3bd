"""Inspection of a part: features of touched points, tolerances, the report sheet."""
