"""The arm as mathematics: geometry, readings, forward kinematics, derivatives."""
