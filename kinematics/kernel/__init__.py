"""The kernel: forward kinematics and derivatives in C, where it could be built."""
