"""How well an identified arm knows distances over its working volume."""
