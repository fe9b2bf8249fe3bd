"""The blind test: hundreds of hidden effects, and how many of them are found."""
