"""Driver of a MicroScribe arm (Immersion HCI 2 and 3)."""
