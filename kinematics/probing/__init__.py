"""The ball and what it touches: surface points, and the probe's vector by pivoting."""
