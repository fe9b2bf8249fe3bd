"""Operating system: systemd, watchdog, real time, memory, log."""
