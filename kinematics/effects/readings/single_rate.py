"""Reading corrections of one parameter: d_alpha is it times some regressor."""

from abc import abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Self

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.effects.base.block import Block
from traverse.kinematics.effects.base.context import EffectContext
from traverse.kinematics.effects.base.correction import ReadingCorrection
from traverse.kinematics.kernel.terms import Form, Quantity, Term
from traverse.kinematics.model.geometry import Geometry

if TYPE_CHECKING:
    from traverse.kinematics.arm_file.arm import Effect


@dataclass(frozen=True, slots=True, kw_only=True)
class SingleRate(ReadingCorrection):
    """One value, the same for every joint that it belongs to."""

    key: ClassVar[str]
    per_value: ClassVar[float] = 1.0  # regressor over quantity

    @classmethod
    def from_file(cls, effect: "Effect", setting: EffectContext) -> Self:
        """Build it from an entry of `[[effects]]`."""
        return cls(joints=setting.joints(effect), values=(effect.values[cls.key],))

    @property
    def parameters(self) -> tuple[str, ...]:
        """The one key of the arm file."""
        return (self.key,)

    @abstractmethod
    def regressor(self, geometry: Geometry, block: Block) -> Floats:
        """d_alpha for the value 1, (n_chosen, n_samples)."""

    def unit_amounts(self, geometry: Geometry, block: Block) -> Floats:
        """The regressor alone, (1, n_chosen, n_samples)."""
        return self.regressor(geometry, block)[np.newaxis]

    @abstractmethod
    def quantity(self, joint: int) -> Quantity:
        """What the value of a joint is multiplied by, besides `per_value`."""

    @property
    def terms(self) -> tuple[Term, ...]:
        """One for every joint."""
        values = (self.per_value * self.values[0],)
        form = Form.READING_RATE
        return tuple(
            Term(form=form, joint=joint, values=values, of=self.quantity(joint))
            for joint in self.affected
        )
