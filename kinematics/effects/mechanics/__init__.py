"""Effects that move or turn bodies of the arm."""
