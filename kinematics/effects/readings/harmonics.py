"""Waves of a reading: errors of an encoder, of a gear or a belt.

d_alpha = cos_rad cos(order alpha) + sin_rad sin(order alpha)
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.effects.base.block import Block
from traverse.kinematics.effects.base.context import EffectContext
from traverse.kinematics.effects.base.correction import ReadingCorrection
from traverse.kinematics.kernel.terms import Form, Term
from traverse.kinematics.model.geometry import Geometry

if TYPE_CHECKING:
    from traverse.kinematics.arm_file.arm import Effect


@dataclass(frozen=True, slots=True, kw_only=True)
class EncoderHarmonic(ReadingCorrection):
    """Waves of an integer order: disc tilt, ellipticity, sub-division error."""

    order: float = 1  # periods a turn

    kind: ClassVar[str] = "encoder_harmonic"

    def unit_amounts(self, geometry: Geometry, block: Block) -> Floats:
        """cos(order alpha) and sin(order alpha), (2, 1, n_samples)."""
        del geometry
        phases_rad = self.order * block.rows("angles_rad", self.joints)
        return np.stack([np.cos(phases_rad), np.sin(phases_rad)])

    @property
    def terms(self) -> tuple[Term, ...]:
        wave = Form.READING_WAVE
        return tuple(
            Term(form=wave, joint=joint, order=self.order, values=self.values)
            for joint in self.affected
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class EncoderEccentricity(EncoderHarmonic):
    """Order 1: a disc or ring that does not turn about its centre."""

    kind: ClassVar[str] = "encoder_eccentricity"


@dataclass(frozen=True, slots=True, kw_only=True)
class TransmissionError(EncoderHarmonic):
    """A wave between motor and joint; `cycles` is its order, seldom an integer.

    The readings continue over turns: other cycles have another phase on the next one.
    Cycles are searched, not estimated, like the moment of a step.
    """

    kind: ClassVar[str] = "transmission_error"

    @classmethod
    def surroundings(cls, effect: "Effect", setting: EffectContext) -> dict[str, Any]:
        del setting
        return {"order": effect.values["cycles"]}
