"""What is played: course, surroundings, faults, and what devices see of them."""
