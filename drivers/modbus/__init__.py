"""Driver of Modbus RTU encoders on an RS-485 line."""
