"""A disc or ring that does not turn about its centre: once a turn.

d_alpha = cos_rad cos alpha + sin_rad sin alpha
"""

from dataclasses import dataclass
from typing import ClassVar

from traverse.kinematics.effects.readings.encoder_harmonic import EncoderHarmonic


@dataclass(frozen=True, slots=True, kw_only=True)
class EncoderEccentricity(EncoderHarmonic):
    """The harmonic of order 1."""

    kind: ClassVar[str] = "encoder_eccentricity"
