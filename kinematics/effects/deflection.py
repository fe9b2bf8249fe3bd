"""The deflected arm: forward kinematics with all that bodies do beyond turning.

From the base outwards, Q_0 the small turn of the mount,

    Q_k = Q_(k-1) R(w_k) R(u_k, theta_k + e_k)
    x   = x_0 + b + sum_k (Q_(k-1) d_k + Q_k r_k (1 + g_k)) + Q_n vector

e_k, w_k, d_k, g_k, b are the sums of all amounts of one target. Where nothing of a
target is there, nothing is computed: without any it is `forward.probe_pose` but for the
last digits.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.effects.base.correction import BodyCorrection, Target
from traverse.kinematics.effects.base.posture import Posture
from traverse.kinematics.model.geometry import Geometry
from traverse.kinematics.model.quaternion import (
    chain_rotations,
    multiply,
    rotate,
    small_turn,
    turn,
)

_VECTORS = (Target.TILT, Target.SHIFT)
_WHOLE = (Target.MOUNT, Target.BASE)


@dataclass(frozen=True, eq=False)
class Deflection:
    """Where the bodies are; without slots, so that derivatives share cached values.

    Attributes:
        rotations: Q_1 ... Q_n, (4, n_joints, n_samples).
        mount: Q_0, (4, n_samples), None where nothing turns it.
        pivot_mm: x_0 + b, (3, n_samples).
        positions_mm: Of the joints' origins and the ball, (3, n_joints + 1, n).
    """

    geometry: Geometry
    rotations: Floats
    mount: Floats | None
    pivot_mm: Floats
    positions_mm: Floats

    @property
    def centres_mm(self) -> Floats:
        return self.positions_mm[:, -1]

    @cached_property
    def carriers(self) -> Floats:
        """Q_0 ... Q_(n-1), the joints' carriers, (4, n_joints, n_samples)."""
        before = np.zeros_like(self.rotations)
        before[:, 1:] = self.rotations[:, :-1]
        if self.mount is None:
            before[0, 0] = 1.0
        else:
            before[:, 0] = self.mount
        return before

    @cached_property
    def reaches_mm(self) -> Floats:
        """From every joint's origin to the ball, (3, n_joints, n_samples)."""
        return self.positions_mm[:, -1:] - self.positions_mm[:, :-1]

    @cached_property
    def axes(self) -> Floats:
        """Q_k u_k, (3, n_joints, n_samples)."""
        return rotate(self.rotations, self.geometry.axes.T[:, :, np.newaxis])


def totals(
    corrections: tuple[BodyCorrection, ...], posture: Posture
) -> dict[Target, Floats]:
    amounts: dict[Target, Floats] = {}
    n_joints, n_samples = posture.turns_rad.shape
    for correction in corrections:
        target = correction.target
        amount = correction.amount(posture)
        if target in _WHOLE:
            amounts[target] = amounts[target] + amount if target in amounts else amount
            continue
        if target not in amounts:
            shape = (n_joints, n_samples)
            amounts[target] = np.zeros((3, *shape) if target in _VECTORS else shape)
        amounts[target][..., correction.joints, :] += amount
    return amounts


def deflection(
    geometry: Geometry, turns_rad: Floats, amounts: Mapping[Target, Floats]
) -> Deflection:
    """Compute the arm from the base outwards.

    Args:
        geometry: the arm.
        turns_rad: theta, (n_joints, n_samples).
        amounts: from `totals`.
    """
    if Target.TURN in amounts:
        turns_rad = turns_rad + amounts[Target.TURN]
    turns = turn(geometry.axes.T[:, :, np.newaxis], turns_rad)
    if Target.TILT in amounts:
        turns = multiply(small_turn(amounts[Target.TILT]), turns)
    mount = small_turn(amounts[Target.MOUNT]) if Target.MOUNT in amounts else None
    if mount is not None:
        turns[:, :1] = multiply(mount[:, np.newaxis], turns[:, :1])
    rotations = chain_rotations(turns)
    links_mm = geometry.links_mm.T[:, :, np.newaxis]
    if Target.GROWTH in amounts:
        links_mm = links_mm * (1.0 + amounts[Target.GROWTH])
    else:
        links_mm = links_mm.copy()
    links_mm[:, -1] += geometry.probe_vector_mm[:, np.newaxis]
    steps_mm = np.empty((3, geometry.n_joints + 1, turns_rad.shape[1]))
    steps_mm[:, 0] = geometry.origin_mm[:, np.newaxis]
    if Target.BASE in amounts:
        steps_mm[:, 0] += amounts[Target.BASE]
    pivot_mm = steps_mm[:, 0].copy()
    steps_mm[:, 1:] = rotate(rotations, links_mm)
    if Target.SHIFT in amounts:
        shifts_mm = amounts[Target.SHIFT].copy()
        shifts_mm[:, 1:] = rotate(rotations[:, :-1], shifts_mm[:, 1:])
        if mount is not None:
            shifts_mm[:, 0] = rotate(mount, shifts_mm[:, 0])
        steps_mm[:, :-1] += shifts_mm
    positions_mm = np.cumsum(steps_mm, axis=1)
    return Deflection(geometry, rotations, mount, pivot_mm, positions_mm)
