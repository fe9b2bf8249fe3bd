"""Conditions of measured numbers; a number is ok while all are established."""
