"""A reading that drifts with time.

    d_alpha = rate_rad_s (t - epoch)

Outside the campaign it keeps the value of the campaign's nearer end, and the sample
is flagged `stale_effect`.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Self

from traverse.arrays import Booleans, Floats
from traverse.kinematics.effects.base.block import Block
from traverse.kinematics.effects.base.context import EffectContext
from traverse.kinematics.effects.base.correction import FlagName
from traverse.kinematics.effects.base.covariate import Covariate, Need
from traverse.kinematics.effects.base.epochs import DriftTime
from traverse.kinematics.effects.readings.single_rate import SingleRate
from traverse.kinematics.kernel.terms import Quantity
from traverse.kinematics.model.geometry import Geometry

if TYPE_CHECKING:
    from traverse.kinematics.arm_file.arm import Effect


@dataclass(frozen=True, slots=True, kw_only=True)
class EncoderDrift(SingleRate):
    """Proportional to the time since the epoch."""

    time: DriftTime

    kind: ClassVar[str] = "encoder_drift"
    key: ClassVar[str] = "rate_rad_s"

    @classmethod
    def from_file(cls, effect: "Effect", setting: EffectContext) -> Self:
        """Build it from an entry of `[[effects]]`."""
        return cls(
            joints=setting.joints(effect),
            values=(effect.values[cls.key],),
            time=DriftTime.from_file(effect, setting),
        )

    @property
    def needs(self) -> tuple[Need, ...]:
        """The time."""
        return (Need(Covariate.UTC),)

    def flags(self, block: Block) -> Iterator[tuple[FlagName, Booleans]]:
        """Flag what is outside the campaign."""
        yield "stale_effect", self.time.is_stale(block)

    def regressor(self, geometry: Geometry, block: Block) -> Floats:
        """Seconds since the epoch, (1, n_samples)."""
        del geometry
        return self.time.since_epoch_s(block)[None]

    def quantity(self, joint: int) -> Quantity:
        """Seconds since the epoch."""
        del joint
        return self.time.quantity
