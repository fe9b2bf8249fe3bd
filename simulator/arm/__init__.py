"""The virtual arm without faults: motion, true values, trajectory, encoders."""
