"""The service: pipeline, capture, publisher, health."""
