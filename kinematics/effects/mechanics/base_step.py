"""A knocked mount: x_0 jumps by step_mm at epoch + at_s and stays there.

The moment is not a parameter: nothing can be differentiated for it. It is scanned.
"""

from dataclasses import dataclass
from typing import ClassVar

from traverse.kinematics.effects.base.epochs import EffectTime, StepTime
from traverse.kinematics.effects.mechanics.base_motion import BaseMotion


@dataclass(frozen=True, slots=True, kw_only=True)
class BaseStep(BaseMotion):
    """Nothing before the moment, all of it from there on; it may be knocked again."""

    kind: ClassVar[str] = "base_step"
    clock: ClassVar[type[EffectTime]] = StepTime
