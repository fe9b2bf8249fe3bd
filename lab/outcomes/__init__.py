"""What the lab's commands conclude: a state, and the reasons for it."""
