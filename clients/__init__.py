"""What connects from outside over MQTT."""
