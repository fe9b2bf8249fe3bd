"""Boards that print lines of text."""
