"""How well an arm and the points that it measures are known."""
