"""Counts lost, or a new reference: a step in one reading that lasts.

    d_alpha = step_rad for t >= epoch + at_s

The moment is not a parameter: nothing can be differentiated for it. It is scanned.
"""

from dataclasses import dataclass
from typing import ClassVar

from traverse.kinematics.effects.base.epochs import EffectTime, StepTime
from traverse.kinematics.effects.readings.single_rate import TimedReading


@dataclass(frozen=True, slots=True, kw_only=True)
class CountSlip(TimedReading):
    """Nothing before the moment, all of it from there on; a joint may slip again."""

    kind: ClassVar[str] = "count_slip"
    clock: ClassVar[type[EffectTime]] = StepTime
