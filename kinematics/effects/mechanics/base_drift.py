"""A base that creeps: x_0 moves by rate_mm_s (t - epoch).

Outside the campaign it keeps the place of the campaign's nearer end, and the sample
is flagged `stale_effect`.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Self

from traverse.arrays import Booleans, Floats
from traverse.kinematics.effects.base.block import Block
from traverse.kinematics.effects.base.context import EffectContext
from traverse.kinematics.effects.base.correction import FlagName
from traverse.kinematics.effects.base.epochs import DriftTime
from traverse.kinematics.effects.mechanics.base_motion import BaseMotion

if TYPE_CHECKING:
    from traverse.kinematics.arm_file.arm import Effect


@dataclass(frozen=True, slots=True, kw_only=True)
class BaseDrift(BaseMotion):
    """Proportional to the time since the epoch."""

    time: DriftTime

    kind: ClassVar[str] = "base_drift"
    key: ClassVar[str] = "rate_mm_s"

    @classmethod
    def from_file(cls, effect: "Effect", setting: EffectContext) -> Self:
        """Build it from an entry of `[[effects]]`."""
        return cls(
            joints=slice(0, 0),
            values=effect.values[cls.key],
            time=DriftTime.from_file(effect, setting),
        )

    def flags(self, block: Block) -> Iterator[tuple[FlagName, Booleans]]:
        """Flag what is outside the campaign."""
        yield "stale_effect", self.time.is_stale(block)

    def course(self, block: Block) -> Floats:
        """Seconds since the epoch, (n_samples,)."""
        return self.time.since_epoch_s(block)
