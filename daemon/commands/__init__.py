"""Commands over MQTT: validation, limits, replies, handlers."""
