"""The error of a gear or a belt: periods a turn of the joint, seldom a whole number.

    d_alpha = cos_rad cos(cycles alpha) + sin_rad sin(cycles alpha)

The readings count on over turns: cycles that are not whole have another phase on the
next one. Cycles are no parameter here: they are searched, like the moment of a step.
"""

from dataclasses import dataclass
from typing import ClassVar

from traverse.kinematics.effects.readings.encoder_harmonic import EncoderHarmonic


@dataclass(frozen=True, slots=True, kw_only=True)
class TransmissionError(EncoderHarmonic):
    """A wave of the reading between motor and joint."""

    kind: ClassVar[str] = "transmission_error"
    key: ClassVar[str] = "cycles"
