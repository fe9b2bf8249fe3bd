"""Connection of a client to the MQTT broker."""
