"""The observation equations: parameters, noise, the network of stations."""
