"""A graduation that is too long or too short, as of a tape, a belt or a gear.

d_alpha = 1e-6 scale_ppm (alpha - zero)
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.effects.base.block import Block
from traverse.kinematics.effects.readings.single_rate import SingleRate
from traverse.kinematics.kernel.terms import Quantity, Source
from traverse.kinematics.model.geometry import Geometry


@dataclass(frozen=True, slots=True, kw_only=True)
class EncoderScale(SingleRate):
    """Proportional to the turn since the base posture."""

    kind: ClassVar[str] = "encoder_scale"
    per_value: ClassVar[float] = 1e-6

    def regressor(self, geometry: Geometry, block: Block) -> Floats:
        """A millionth of the turn, (1, n_samples) rad/ppm."""
        zeros_rad = geometry.zeros_rad[self.joints, np.newaxis]
        return 1e-6 * (block.rows("angles_rad", self.joints) - zeros_rad)

    def quantity(self, joint: int) -> Quantity:
        """The turn since the base posture."""
        return Quantity(Source.TURN, joint)
