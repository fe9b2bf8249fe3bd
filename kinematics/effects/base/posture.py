"""The undeflected posture: where the arm would be if it were rigid and true.

The corrected turns theta = alpha - zero - d_alpha alone make it. All mechanical
effects are functions of it, so none of them depends on another.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.effects.base.block import Block
from traverse.kinematics.effects.base.bodies import Bodies, gravity_moments_nm
from traverse.kinematics.model.geometry import Geometry
from traverse.kinematics.model.quaternion import (
    chain_rotations,
    conjugate,
    rotate,
    turn,
)


@dataclass(frozen=True, eq=False)
class Posture:
    """Without slots, so that what is computed for one effect is kept for the next.

    Attributes:
        gravity_m_s2: (3,).
        turns_rad: theta, (n_joints, n_samples).
    """

    geometry: Geometry
    block: Block
    bodies: Bodies
    gravity_m_s2: Floats
    turns_rad: Floats

    @cached_property
    def rotations(self) -> Floats:
        """P_1 ... P_n, (4, n_joints, n_samples)."""
        axes = self.geometry.axes.T[:, :, np.newaxis]
        return chain_rotations(turn(axes, self.turns_rad))

    @cached_property
    def axes(self) -> Floats:
        """P_k u_k, where the axes are, (3, n_joints, n_samples)."""
        return rotate(self.rotations, self.geometry.axes.T[:, :, np.newaxis])

    @cached_property
    def moments_nm(self) -> Floats:
        """Of gravity about the joints' origins, (3, n_joints, n_samples)."""
        return gravity_moments_nm(
            self.geometry, self.bodies, self.gravity_m_s2, self.rotations
        )

    def in_carrier(self, vectors: Floats, joint: int) -> Floats:
        """Turn vectors back by P_(k-1), (3, n_samples), as if in the base posture."""
        if joint == 0:
            return vectors
        return rotate(conjugate(self.rotations[:, joint - 1]), vectors)
