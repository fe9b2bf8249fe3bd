"""Forward kinematics: readings of the joints to the pose of the probe.

With P_k = R(u_1, alpha_1 - alpha0_1) ... R(u_k, alpha_k - alpha0_k), everything
written in the base posture (Benciolini and Vitti, 2017):

    x         = x_0 + sum_k P_k r_k + P_n vector        the ball's centre
    direction = P_n d                                   the shank, towards the ball
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from kinematics.geometry import Geometry
from kinematics.quaternion import multiply, rotate, turn

Floats = NDArray[np.float64]


def probe_pose(geometry: Geometry, angles_rad: Floats) -> tuple[Floats, Floats]:
    """Compute where the probe is and where its shank points.

    A sample's result does not depend on the block it comes in, bit for bit.

    Args:
        geometry: The arm.
        angles_rad: Readings, (n_samples, n_joints).

    Returns:
        Centres of the ball in mm and unit directions of the shank, both
        (n_samples, 3).
    """
    positions_mm, rotations = _walk(geometry, angles_rad)
    centres_mm = positions_mm[-1]
    directions = rotate(rotations, geometry.probe_direction)
    return np.ascontiguousarray(centres_mm.T), np.ascontiguousarray(directions.T)


def probe_centre(geometry: Geometry, angles_rad: Floats) -> Floats:
    """Compute the ball's centres in mm: (n_samples, n_joints) -> (n_samples, 3)."""
    positions_mm, _ = _walk(geometry, angles_rad)
    return np.ascontiguousarray(positions_mm[-1].T)


def stylus_direction(geometry: Geometry, angles_rad: Floats) -> Floats:
    """Compute the shank's unit vectors: (n_samples, n_joints) -> (n_samples, 3)."""
    *_, rotations = _rotations(geometry, angles_rad)
    return np.ascontiguousarray(rotate(rotations, geometry.probe_direction).T)


def joint_positions(geometry: Geometry, angles_rad: Floats) -> Floats:
    """Compute the skeleton: every joint's origin, the first at x_0, then the probe.

    Args:
        geometry: The arm.
        angles_rad: Readings, (n_samples, n_joints).

    Returns:
        Positions in mm, (n_samples, n_joints + 1, 3).
    """
    positions_mm, _ = _walk(geometry, angles_rad)
    return np.ascontiguousarray(np.stack(positions_mm).transpose(2, 0, 1))


def _walk(geometry: Geometry, angles_rad: Floats) -> tuple[list[Floats], Floats]:
    """Go from the base outwards.

    Returns:
        x_0, the joints after the first and the probe in mm, each (3, n_samples),
        and P_n, (4, n_samples).
    """
    n_samples = len(angles_rad)
    position_mm = np.repeat(geometry.origin_mm[:, np.newaxis], n_samples, axis=1)
    positions_mm = [position_mm]
    links_mm = geometry.links_mm.copy()
    links_mm[-1] += geometry.probe_vector_mm
    rotations = np.empty((4, n_samples))
    for link_mm, rotations in zip(
        links_mm, _rotations(geometry, angles_rad), strict=True
    ):
        position_mm = position_mm + rotate(rotations, link_mm)
        positions_mm.append(position_mm)
    return positions_mm, rotations


def _rotations(geometry: Geometry, angles_rad: Floats) -> Iterator[Floats]:
    """Yield P_1 ... P_n, each (4, n_samples)."""
    expected = geometry.n_joints
    if angles_rad.ndim != 2 or angles_rad.shape[1] != expected:
        raise ValueError(
            f"angles_rad has shape {angles_rad.shape}, expected (n_samples, "
            f"{expected}): one column a joint of the arm"
        )
    # Contiguous rows: strided ones may take another path through sin and cos.
    turns_rad = np.ascontiguousarray((angles_rad - geometry.zeros_rad).T)
    rotations = turn(geometry.axes[0], turns_rad[0])
    yield rotations
    for axis, turn_rad in zip(geometry.axes[1:], turns_rad[1:], strict=True):
        rotations = multiply(rotations, turn(axis, turn_rad))
        yield rotations
