"""Tests: points for programs that do not speak MQTT."""
