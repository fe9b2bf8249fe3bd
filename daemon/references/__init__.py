"""References of devices: which were confirmed, and what puts them in doubt."""
