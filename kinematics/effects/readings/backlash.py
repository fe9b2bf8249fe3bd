"""Play between the joint and its encoder: two-valued by the sense of approach.

    d_alpha = half_width_rad sign(direction of approach)

An approach of 0, a joint that did not move, is corrected by nothing.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.effects.base.block import Block
from traverse.kinematics.effects.base.covariate import Covariate, Need
from traverse.kinematics.effects.readings.single_rate import SingleRate
from traverse.kinematics.kernel.terms import Quantity, Source
from traverse.kinematics.model.geometry import Geometry


@dataclass(frozen=True, slots=True, kw_only=True)
class Backlash(SingleRate):
    """Half the play, with the sign of the last motion."""

    kind: ClassVar[str] = "backlash"

    @property
    def needs(self) -> tuple[Need, ...]:
        """The joint's sense of approach."""
        return (Need(Covariate.APPROACH, self.joints.start),)

    def regressor(self, geometry: Geometry, block: Block) -> Floats:
        """-1, 0 or +1, (1, n_samples)."""
        del geometry
        return np.sign(block.rows("approaches", self.joints))

    def quantity(self, joint: int) -> Quantity:
        """-1, 0 or +1."""
        return Quantity(Source.SENSE, joint)
