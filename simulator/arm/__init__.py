"""The virtual arm without faults: its motion, true values, trajectory and encoders."""
