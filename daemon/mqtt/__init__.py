"""Connection to the MQTT broker: queue, sending, commands, credentials."""
