"""Common parts of commands: options, inputs, refusals, messages as text."""
