"""What commands share: options, inputs, refusals, messages as text."""
