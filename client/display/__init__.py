"""State of an arm for displays, independent of the medium."""
