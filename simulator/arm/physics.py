"""The virtual arm's motion: products of exponentials in 4x4 matrices.

Joint k turns everything that follows it about the line through its origin along its
axis, both in the base posture, so that

    T_k = exp(S_1 theta_1) ... exp(S_k theta_k),     x = T_n x_base

with theta the turns from the base posture. See Brockett (1984) and Murray, Li and
Sastry, A Mathematical Introduction to Robotic Manipulation (1994), chapter 3.
"""

from dataclasses import dataclass

import numpy as np

from traverse.arrays import Floats


@dataclass(frozen=True, slots=True)
class Mechanism:
    """An arm in its base posture.

    Attributes:
        origins_mm: (n_joints, 3) a point of each joint's line.
        axes: (n_joints, 3) unit vectors.
        probe_mm: (3,) centre of the ball.
        shank: (3,) unit vector towards the ball.
    """

    origins_mm: Floats
    axes: Floats
    probe_mm: Floats
    shank: Floats

    @property
    def n_joints(self) -> int:
        return len(self.axes)


def turn_matrices(axis: Floats, origin_mm: Floats, turns_rad: Floats) -> Floats:
    """Compute rotations about lines: Rodrigues' formula.

    Args:
        axis: Unit vectors, (3,) or (n_lines, 3).
        origin_mm: A point of each line, alike.
        turns_rad: (n,) or (n, n_lines).

    Returns:
        (n, 4, 4) or (n, n_lines, 4, 4).
    """
    cross = np.zeros((*axis.shape, 3))
    cross[..., [2, 0, 1], [1, 2, 0]] = axis
    cross[..., [1, 2, 0], [2, 0, 1]] = -axis
    sines = np.sin(turns_rad)[..., None, None]
    versines = (1.0 - np.cos(turns_rad))[..., None, None]
    matrices = np.zeros((*turns_rad.shape, 4, 4))
    rotations = np.eye(3) + sines * cross + versines * (cross @ cross)
    matrices[..., :3, :3] = rotations
    matrices[..., :3, 3] = origin_mm - (rotations @ origin_mm[..., None])[..., 0]
    matrices[..., 3, 3] = 1.0
    return matrices


def body_motions(mechanism: Mechanism, turns_rad: Floats) -> Floats:
    """Compute the motion of every body from the base posture, for (n, n_joints).

    Returns:
        (n, n_joints + 1, 4, 4): the identity, then T_1 to T_n.
    """
    motions = np.empty((len(turns_rad), mechanism.n_joints + 1, 4, 4))
    motions[:, 0] = np.eye(4)
    turned = turn_matrices(mechanism.axes, mechanism.origins_mm, turns_rad)
    for k in range(mechanism.n_joints):
        motions[:, k + 1] = motions[:, k] @ turned[:, k]
    return motions


def probe_pose(mechanism: Mechanism, turns_rad: Floats) -> tuple[Floats, Floats]:
    """Ball centres (n, 3) [mm] and shank directions (n, 3) for turns (n, n_joints)."""
    last = body_motions(mechanism, turns_rad)[:, -1]
    return (
        last[:, :3, :3] @ mechanism.probe_mm + last[:, :3, 3],
        last[:, :3, :3] @ mechanism.shank,
    )


def centre_rates(mechanism: Mechanism, turns_rad: Floats) -> tuple[Floats, Floats]:
    """Compute ball centres (n, 3) and their derivatives (n, 3, n_joints) [mm/rad].

    A turn about axis u through the point o moves x by u x (x - o).
    """
    centres, _, axes, origins = _lines(mechanism, turns_rad)
    rates = _cross(axes, centres[:, None] - origins)
    return centres, rates.transpose(0, 2, 1)


def probe_rates(
    mechanism: Mechanism, turns_rad: Floats
) -> tuple[Floats, Floats, Floats, Floats]:
    """Compute the pose and its derivatives by the turns.

    Returns:
        Centres (n, 3), shanks (n, 3), d centre / d turn (n, 3, n_joints) [mm/rad],
        d shank / d turn (n, 3, n_joints): a turn about axis u through the point o
        moves x by u x (x - o) and a direction d by u x d.
    """
    centres, last, axes, origins = _lines(mechanism, turns_rad)
    shanks = last @ mechanism.shank
    rates = _cross(axes, centres[:, None] - origins)
    shank_rates = _cross(axes, shanks[:, None])
    return (
        centres,
        shanks,
        rates.transpose(0, 2, 1),
        shank_rates.transpose(0, 2, 1),
    )


def _lines(
    mechanism: Mechanism, turns_rad: Floats
) -> tuple[Floats, Floats, Floats, Floats]:
    """Compute centres, rotations of the last body, directions and places of hinges."""
    motions = body_motions(mechanism, turns_rad)
    turned, shifts = motions[:, :, :3, :3], motions[:, :, :3, 3]
    centres = turned[:, -1] @ mechanism.probe_mm + shifts[:, -1]
    axes = np.einsum("mkij,kj->mki", turned[:, :-1], mechanism.axes)
    origins = np.einsum("mkij,kj->mki", turned[:, :-1], mechanism.origins_mm)
    origins += shifts[:, :-1]
    return centres, turned[:, -1], axes, origins


def _cross(first: Floats, second: Floats) -> Floats:
    """Compute u x v; for many small vectors faster than NumPy's."""
    product = np.empty(np.broadcast_shapes(first.shape, second.shape))
    for axis, (left, right) in enumerate(((1, 2), (2, 0), (0, 1))):
        product[..., axis] = (
            first[..., left] * second[..., right]
            - first[..., right] * second[..., left]
        )
    return product
