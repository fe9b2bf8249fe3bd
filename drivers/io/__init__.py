"""Serial ports and CAN buses, opened for one reader thread."""
