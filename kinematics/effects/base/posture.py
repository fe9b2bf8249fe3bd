"""The undeflected posture of a rigid and true arm.

It follows from the corrected turns theta = alpha - zero - d_alpha. All mechanical
effects are functions of it, so that none depends on another.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.effects.base.block import Block
from traverse.kinematics.effects.base.bodies import gravity_moments_nm
from traverse.kinematics.model.geometry import Geometry
from traverse.kinematics.model.quaternion import (
    chain_rotations,
    conjugate,
    cross,
    rotate,
    turn,
)


@dataclass(frozen=True, eq=False)
class Posture:
    """Without slots, so that values computed for one effect are kept for the next.

    Attributes:
        levers_kg_mm: Contributions of the elements to the mass moment, (n_joints, 3).
        gravity_m_s2: (3,).
        turns_rad: theta, (n_joints, n_samples).
    """

    geometry: Geometry
    block: Block
    levers_kg_mm: Floats
    gravity_m_s2: Floats
    turns_rad: Floats

    @cached_property
    def rotations(self) -> Floats:
        """P_1 ... P_n, (4, n_joints, n_samples)."""
        axes = self.geometry.axes.T[:, :, np.newaxis]
        return chain_rotations(turn(axes, self.turns_rad))

    @cached_property
    def axes(self) -> Floats:
        """Directions of the axes, P_k u_k, (3, n_joints, n_samples)."""
        return rotate(self.rotations, self.geometry.axes.T[:, :, np.newaxis])

    @cached_property
    def moments_nm(self) -> Floats:
        """Moments of gravity about the joints' origins, (3, n_joints, n_samples)."""
        return gravity_moments_nm(self.levers_kg_mm, self.gravity_m_s2, self.rotations)

    def moments_of(self, joint: int, component: int) -> Floats:
        """Return moments by 1 kg m along x, y or z, about a joint and all inwards.

        The same about each of them: (3, n_joints, n_samples) [N m].
        """
        unit = np.eye(3)[component, :, np.newaxis]
        moment_nm = cross(rotate(self.rotations[:, joint], unit), self.gravity_m_s2)
        return np.broadcast_to(moment_nm[:, np.newaxis], (3, *self.turns_rad.shape))

    def in_carrier(self, vectors: Floats, joint: int) -> Floats:
        """Rotate vectors (3, n_samples) back by P_(k-1) to the base posture."""
        if joint == 0:
            return vectors
        return rotate(conjugate(self.rotations[:, joint - 1]), vectors)
