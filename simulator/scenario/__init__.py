"""The played scenario: course, surroundings, faults, and inputs of devices."""
