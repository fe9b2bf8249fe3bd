"""State that displays of an arm show, independent of the medium."""
