"""Gateways: points for programs that do not speak MQTT."""
