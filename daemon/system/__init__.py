"""Operating system: systemd, watchdog, real-time settings, memory, lifecycle."""
