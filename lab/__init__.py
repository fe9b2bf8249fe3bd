"""Off-line work on an arm; needs the extra `lab`."""
