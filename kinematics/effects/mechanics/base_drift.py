"""A base that creeps: x_0 moves by rate_mm_s (t - epoch).

Outside the campaign it keeps the place of the campaign's nearer end, and the sample
is flagged `stale_effect`.
"""

from dataclasses import dataclass
from typing import ClassVar

from traverse.kinematics.effects.base.epochs import DriftTime, EffectTime
from traverse.kinematics.effects.mechanics.base_motion import BaseMotion


@dataclass(frozen=True, slots=True, kw_only=True)
class BaseDrift(BaseMotion):
    """Proportional to the time since the epoch."""

    kind: ClassVar[str] = "base_drift"
    clock: ClassVar[type[EffectTime]] = DriftTime
