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
    """Return rotations (n, 4, 4) about a line by turns (n,): Rodrigues' formula."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    sines = np.sin(turns_rad)[:, None, None]
    versines = (1.0 - np.cos(turns_rad))[:, None, None]
    matrices = np.zeros((len(turns_rad), 4, 4))
    matrices[:, :3, :3] = np.eye(3) + sines * cross + versines * (cross @ cross)
    matrices[:, :3, 3] = origin_mm - matrices[:, :3, :3] @ origin_mm
    matrices[:, 3, 3] = 1.0
    return matrices


def body_motions(mechanism: Mechanism, turns_rad: Floats) -> Floats:
    """Compute the motion of every body from the base posture, for (n, n_joints).

    Returns:
        (n, n_joints + 1, 4, 4): the identity, then T_1 to T_n.
    """
    motions = np.empty((len(turns_rad), mechanism.n_joints + 1, 4, 4))
    motions[:, 0] = np.eye(4)
    lines = zip(mechanism.axes, mechanism.origins_mm, strict=True)
    for k, (axis, origin_mm) in enumerate(lines):
        motions[:, k + 1] = motions[:, k] @ turn_matrices(
            axis, origin_mm, turns_rad[:, k]
        )
    return motions


def probe_pose(mechanism: Mechanism, turns_rad: Floats) -> tuple[Floats, Floats]:
    """Ball centres (n, 3) [mm] and shank directions (n, 3) for turns (n, n_joints)."""
    last = body_motions(mechanism, turns_rad)[:, -1]
    return (
        last[:, :3, :3] @ mechanism.probe_mm + last[:, :3, 3],
        last[:, :3, :3] @ mechanism.shank,
    )


def probe_rates(
    mechanism: Mechanism, turns_rad: Floats
) -> tuple[Floats, Floats, Floats, Floats]:
    """Compute the pose and its derivatives by the turns.

    Returns:
        Centres (n, 3), shanks (n, 3), d centre / d turn (n, 3, n_joints) [mm/rad],
        d shank / d turn (n, 3, n_joints): a turn about axis u through the point o
        moves x by u x (x - o) and a direction d by u x d.
    """
    motions = body_motions(mechanism, turns_rad)
    turned, shifts = motions[:, :, :3, :3], motions[:, :, :3, 3]
    centres = turned[:, -1] @ mechanism.probe_mm + shifts[:, -1]
    shanks = turned[:, -1] @ mechanism.shank
    axes = np.einsum("mkij,kj->mki", turned[:, :-1], mechanism.axes)
    origins = np.einsum("mkij,kj->mki", turned[:, :-1], mechanism.origins_mm)
    origins += shifts[:, :-1]
    centre_rates = np.cross(axes, centres[:, None] - origins)
    shank_rates = np.cross(axes, shanks[:, None])
    return (
        centres,
        shanks,
        centre_rates.transpose(0, 2, 1),
        shank_rates.transpose(0, 2, 1),
    )
