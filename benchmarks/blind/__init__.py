"""The blind test: hundreds of hidden effects, and the share that is found."""
