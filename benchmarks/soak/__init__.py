"""The crash test: programs and networks killed at random while points are taken."""
