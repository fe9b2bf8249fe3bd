"""The kernel in C, and effects as it takes them; `model.kernel_choice` chooses it."""
