"""Bytes of CANopen nodes and of SocketCAN error frames."""
