"""The daily check with a cone and a sphere, its history and control charts."""
