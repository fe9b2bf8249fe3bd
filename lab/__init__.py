"""Off-line work on an arm: identification, diagnosis, acceptance. Needs the extra `lab`."""
