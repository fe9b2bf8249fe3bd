"""Driver of CANopen encoders (CiA 301, CiA 406)."""
