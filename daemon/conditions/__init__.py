"""Conditions that every number rests on: a number is ok while all are established."""
