"""A knocked mount: x_0 jumps by step_mm at epoch + at_s and stays there.

The moment is not a parameter: nothing can be differentiated for it. It is scanned.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Self

from traverse.arrays import Floats
from traverse.kinematics.effects.base.block import Block
from traverse.kinematics.effects.base.context import EffectContext
from traverse.kinematics.effects.base.epochs import StepTime
from traverse.kinematics.effects.mechanics.base_motion import BaseMotion

if TYPE_CHECKING:
    from traverse.kinematics.arm_file.arm import Effect


@dataclass(frozen=True, slots=True, kw_only=True)
class BaseStep(BaseMotion):
    """Nothing before the moment, all of it from there on."""

    time: StepTime

    kind: ClassVar[str] = "base_step"
    key: ClassVar[str] = "step_mm"

    @classmethod
    def from_file(cls, effect: "Effect", setting: EffectContext) -> Self:
        """Build it from an entry of `[[effects]]`."""
        return cls(
            joints=slice(0, 0),
            values=effect.values[cls.key],
            time=StepTime.from_file(effect, setting),
        )

    @property
    def variety(self) -> tuple[str, ...]:
        """The moment: a mount may be knocked more than once."""
        return (f"{self.time.at_s:g}s",)

    def course(self, block: Block) -> Floats:
        """0 or 1, (n_samples,)."""
        return self.time.has_occurred(block)
