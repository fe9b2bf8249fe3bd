"""The ball and the touched surface: compensation and pivoting."""
