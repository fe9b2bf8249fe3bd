"""Counts lost, or a new reference: a step in one reading that lasts.

    d_alpha = step_rad for t >= epoch + at_s

The moment is not a parameter: nothing can be differentiated for it. It is scanned.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Self

from traverse.arrays import Floats
from traverse.kinematics.effects.base.block import Block
from traverse.kinematics.effects.base.context import EffectContext
from traverse.kinematics.effects.base.covariate import Covariate, Need
from traverse.kinematics.effects.base.epochs import StepTime
from traverse.kinematics.effects.readings.single_rate import SingleRate
from traverse.kinematics.kernel.terms import Quantity
from traverse.kinematics.model.geometry import Geometry

if TYPE_CHECKING:
    from traverse.kinematics.arm_file.arm import Effect


@dataclass(frozen=True, slots=True, kw_only=True)
class CountSlip(SingleRate):
    """Nothing before the moment, all of it from there on."""

    time: StepTime

    kind: ClassVar[str] = "count_slip"
    key: ClassVar[str] = "step_rad"

    @classmethod
    def from_file(cls, effect: "Effect", setting: EffectContext) -> Self:
        """Build it from an entry of `[[effects]]`."""
        return cls(
            joints=setting.joints(effect),
            values=(effect.values[cls.key],),
            time=StepTime.from_file(effect, setting),
        )

    @property
    def variety(self) -> tuple[str, ...]:
        """The moment: a joint may slip more than once."""
        return (f"{self.time.at_s:g}s",)

    @property
    def needs(self) -> tuple[Need, ...]:
        """The time."""
        return (Need(Covariate.UTC),)

    def regressor(self, geometry: Geometry, block: Block) -> Floats:
        """0 or 1, (1, n_samples)."""
        del geometry
        return self.time.has_occurred(block)[None]

    def quantity(self, joint: int) -> Quantity:
        """0 or 1."""
        del joint
        return self.time.quantity
