"""A ring behind a gear of 2:1 that is not centred: half a wave a turn of the joint."""

from dataclasses import dataclass
from typing import Any, ClassVar

from traverse.kinematics.arm_file.arm import Effect
from traverse.kinematics.effect_table import EffectKind, Family
from traverse.kinematics.effects.base.context import EffectContext
from traverse.kinematics.effects.readings.harmonics import EncoderHarmonic


@dataclass(frozen=True, slots=True, kw_only=True)
class HalfWave(EncoderHarmonic):
    """d_alpha = cos_rad cos(alpha / 2) + sin_rad sin(alpha / 2)."""

    kind: ClassVar[str] = "half_wave"
    row: ClassVar[EffectKind] = EffectKind(
        family=Family.OWN_ANGLE,
        keys={"cos_rad": float, "sin_rad": float},
        size=2e-5,
        label="wave of half a period a turn",
        covariates=("{}_rad",),
    )

    @classmethod
    def surroundings(cls, effect: Effect, setting: EffectContext) -> dict[str, Any]:
        return {"order": 0.5}
