"""Driver of a latching controller board (docs/serial-protocol.md)."""
