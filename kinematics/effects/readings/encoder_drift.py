"""A reading that drifts with time.

    d_alpha = rate_rad_s (t - epoch)

Outside the campaign it keeps the value of the campaign's nearer end, and the sample
is flagged `stale_effect`.
"""

from dataclasses import dataclass
from typing import ClassVar

from traverse.kinematics.effects.base.epochs import DriftTime, EffectTime
from traverse.kinematics.effects.readings.single_rate import TimedReading


@dataclass(frozen=True, slots=True, kw_only=True)
class EncoderDrift(TimedReading):
    """Proportional to the time since the epoch."""

    kind: ClassVar[str] = "encoder_drift"
    clock: ClassVar[type[EffectTime]] = DriftTime
