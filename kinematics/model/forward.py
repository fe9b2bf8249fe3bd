"""Forward kinematics: readings of the joints to the pose of the probe.

With P_k = R(u_1, alpha_1 - alpha0_1) ... R(u_k, alpha_k - alpha0_k), everything
written in the base posture (Benciolini and Vitti, 2017):

    x         = x_0 + sum_k P_k r_k + P_n vector        the ball's centre
    direction = P_n d                                   the shank, towards the ball

The functions called numpy_... are the readable definition, and compute where the kernel
in C was not built or is disabled; both take what encoders on the hinges would read.
The ball is reached from the tip inwards, which needs no P_k; the skeleton goes outwards
with P_k as quaternions.
"""

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.model.backward_recursion import (
    BackwardRecursion,
    JointRotations,
)
from traverse.kinematics.model.geometry import Geometry
from traverse.kinematics.model.kernel_choice import checked_readings, compiled_chain
from traverse.kinematics.model.quaternion import chain_rotations, rotate, turn

# Samples computed at a time: so many that calling NumPy costs less than its arithmetic,
# so few that 0.25 kB each stay in the cache.
_CHUNK_SAMPLES = 4096


def probe_pose(geometry: Geometry, angles_rad: Floats) -> tuple[Floats, Floats]:
    """Compute ball centres and shank directions.

    A sample's result does not depend on the block it comes in, bit for bit.

    Args:
        geometry: the arm.
        angles_rad: readings, (n_samples, n_joints).

    Returns:
        Centres of the ball in mm and unit directions of the shank, both
        (n_samples, 3).
    """
    angles_rad = checked_readings(geometry, angles_rad)
    chain = compiled_chain(geometry)
    if chain is None:
        return numpy_pose(geometry, angles_rad)
    return chain.poses(angles_rad)


def probe_centre(geometry: Geometry, angles_rad: Floats) -> Floats:
    """Compute the ball's centres in mm: (n_samples, n_joints) -> (n_samples, 3)."""
    angles_rad = checked_readings(geometry, angles_rad)
    chain = compiled_chain(geometry)
    if chain is None:
        return numpy_centre(geometry, angles_rad)
    return chain.centres(angles_rad)


def joint_positions(geometry: Geometry, angles_rad: Floats) -> Floats:
    """Compute the skeleton: every joint's origin, the first at x_0, then the probe.

    Args:
        geometry: The arm.
        angles_rad: Readings, (n_samples, n_joints).

    Returns:
        Positions in mm, (n_samples, n_joints + 1, 3).
    """
    angles_rad = checked_readings(geometry, angles_rad)
    chain = compiled_chain(geometry)
    if chain is None:
        return numpy_positions(geometry, angles_rad)
    return chain.positions(angles_rad)


def body_rotations(geometry: Geometry, angles_rad: Floats) -> Floats:
    """Compute P_n of the last body: (n_samples, n_joints) -> (4, n_samples)."""
    last: Floats = _rotations(geometry, checked_readings(geometry, angles_rad))[:, -1]
    return last


def numpy_pose(geometry: Geometry, angles_rad: Floats) -> tuple[Floats, Floats]:
    """Compute `probe_pose` in NumPy: v <- R(u_k, theta_k) (r_k + v)."""
    centres_mm = np.empty((len(angles_rad), 3))
    directions = np.empty((len(angles_rad), 3))
    for chunk in chunks(len(angles_rad)):
        turns = JointRotations(angles_rad[chunk], geometry.zeros_rad)
        centres_mm[chunk] = _centre_mm(geometry, turns)
        shank = BackwardRecursion(geometry.probe_direction, turns)
        for joint in reversed(range(geometry.n_joints)):
            shank.turn(geometry.axes[joint], joint)
        directions[chunk] = shank.vectors.T
    return centres_mm, directions


def numpy_centre(geometry: Geometry, angles_rad: Floats) -> Floats:
    centres_mm = np.empty((len(angles_rad), 3))
    for chunk in chunks(len(angles_rad)):
        turns = JointRotations(angles_rad[chunk], geometry.zeros_rad)
        centres_mm[chunk] = _centre_mm(geometry, turns)
    return centres_mm


def numpy_positions(geometry: Geometry, angles_rad: Floats) -> Floats:
    positions_mm = np.empty((len(angles_rad), geometry.n_joints + 1, 3))
    for chunk in chunks(len(angles_rad)):
        rotations = _rotations(geometry, angles_rad[chunk])
        positions_mm[chunk] = _positions_mm(geometry, rotations).transpose(2, 1, 0)
    return positions_mm


def chunks(n_samples: int, chunk_samples: int = _CHUNK_SAMPLES) -> list[slice]:
    """Cut samples into parts of at most ``chunk_samples``."""
    return [
        slice(start, min(start + chunk_samples, n_samples))
        for start in range(0, n_samples, chunk_samples)
    ]


def _centre_mm(geometry: Geometry, turns: JointRotations) -> Floats:
    ball = BackwardRecursion(geometry.probe_vector_mm, turns)
    for joint in reversed(range(geometry.n_joints)):
        ball.vectors += geometry.links_mm[joint, :, np.newaxis]
        ball.turn(geometry.axes[joint], joint)
    return ball.vectors.T + geometry.origin_mm


def _rotations(geometry: Geometry, angles_rad: Floats) -> Floats:
    """Compute P_1 ... P_n, (4, n_joints, n_samples)."""
    # Contiguous rows: strided ones may take another path through sin and cos.
    turns_rad = np.ascontiguousarray((angles_rad - geometry.zeros_rad).T)
    return chain_rotations(turn(geometry.axes.T[:, :, np.newaxis], turns_rad))


def _positions_mm(geometry: Geometry, rotations: Floats) -> Floats:
    """Compute (3, n_joints + 1, n_samples) from x_0 outwards, the probe last."""
    links_mm = geometry.links_mm.copy()
    links_mm[-1] += geometry.probe_vector_mm
    steps_mm = np.empty((3, geometry.n_joints + 1, rotations.shape[2]))
    steps_mm[:, 0] = geometry.origin_mm[:, np.newaxis]
    steps_mm[:, 1:] = rotate(rotations, links_mm.T[:, :, np.newaxis])
    return np.cumsum(steps_mm, axis=1)
