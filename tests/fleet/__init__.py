"""Stores of many arms."""
