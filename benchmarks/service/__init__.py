"""What the daemon costs and bears."""
