"""Transforms as 4x4 matrices, written out here."""

import numpy as np


def rotation(axis, angle_rad):
    """A rotation by Rodrigues' formula."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    matrix = np.eye(4)
    matrix[:3, :3] += np.sin(angle_rad) * cross
    matrix[:3, :3] += (1.0 - np.cos(angle_rad)) * cross @ cross
    return matrix


def place(xyz_mm, rpy_rad=(0, 0, 0)):
    """Shift and turn as the URDF specification says: R_z(yaw) R_y(pitch) R_x(roll)."""
    roll, pitch, yaw = rpy_rad
    matrix = (
        rotation([0, 0, 1], yaw)
        @ rotation([0, 1, 0], pitch)
        @ rotation([1, 0, 0], roll)
    )
    matrix[:3, 3] = xyz_mm
    return matrix
