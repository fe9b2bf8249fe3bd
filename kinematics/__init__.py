"""The arm as mathematics: numpy only, millimetres and radians."""
