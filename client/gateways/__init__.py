"""Points for programs that do not speak MQTT."""
