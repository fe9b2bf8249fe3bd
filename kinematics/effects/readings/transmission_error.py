"""The error of a gear or a belt: periods a turn of the joint, seldom a whole number.

    d_alpha = cos_rad cos(cycles alpha) + sin_rad sin(cycles alpha)

The readings count on over turns: cycles that are not whole have another phase on the
next one. Cycles are no parameter here: they are searched, like the moment of a step.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Self

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
class TransmissionError(ReadingCorrection):
    """A wave of the reading between motor and joint."""

    cycles: float

    kind: ClassVar[str] = "transmission_error"

    @classmethod
    def from_file(cls, effect: "Effect", setting: EffectContext) -> Self:
        """Build it from an entry of `[[effects]]`."""
        values = effect.values
        return cls(
            joints=setting.joints(effect),
            values=(values["cos_rad"], values["sin_rad"]),
            cycles=values["cycles"],
        )

    @property
    def parameters(self) -> tuple[str, ...]:
        """Keys of the arm file."""
        return "cos_rad", "sin_rad"

    @property
    def variety(self) -> tuple[str, ...]:
        """The cycles: a joint may have several stages of gears."""
        return (f"{self.cycles:g}",)

    def unit_amounts(self, geometry: Geometry, block: Block) -> Floats:
        """cos(cycles alpha) and sin(cycles alpha), (2, 1, n_samples)."""
        del geometry
        phases_rad = self.cycles * block.rows("angles_rad", self.joints)
        return np.stack([np.cos(phases_rad), np.sin(phases_rad)])

    @property
    def terms(self) -> tuple[Term, ...]:
        """One wave for every joint."""
        return tuple(
            Term(
                form=Form.READING_WAVE,
                joint=joint,
                order=self.cycles,
                values=self.values,
            )
            for joint in self.affected
        )
