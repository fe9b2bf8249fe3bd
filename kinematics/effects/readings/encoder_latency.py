"""Readings that are older than their time says.

    d_alpha = -latency_s d(alpha)/dt

Without a joint it is the same for all of them: a clock, not a filter.
"""

from dataclasses import dataclass
from typing import ClassVar

from traverse.arrays import Floats
from traverse.kinematics.effects.base.block import Block
from traverse.kinematics.effects.base.covariate import Covariate, Need, needs_of
from traverse.kinematics.effects.readings.single_rate import SingleRate
from traverse.kinematics.kernel.terms import Quantity, Source
from traverse.kinematics.model.geometry import Geometry


@dataclass(frozen=True, slots=True, kw_only=True)
class EncoderLatency(SingleRate):
    """Proportional to the speed, against it."""

    kind: ClassVar[str] = "encoder_latency"
    per_value: ClassVar[float] = -1.0

    @property
    def needs(self) -> tuple[Need, ...]:
        """The speeds of its joints."""
        return needs_of(Covariate.SPEED, self.joints, self.joints.stop)

    def regressor(self, geometry: Geometry, block: Block) -> Floats:
        """-d(alpha)/dt, (n_chosen, n_samples) rad/s."""
        del geometry
        return -block.rows("speeds_rad_s", self.joints)

    def quantity(self, joint: int) -> Quantity:
        """d(alpha)/dt."""
        return Quantity(Source.SPEED, joint)
