"""Commands over MQTT: validation, limits, replies, and one handler each."""
