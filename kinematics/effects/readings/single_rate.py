"""Reading corrections of one parameter: d_alpha is it times some regressor."""

from abc import abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from traverse.arrays import Booleans, Floats
from traverse.kinematics.effects.base.block import Block
from traverse.kinematics.effects.base.context import EffectContext
from traverse.kinematics.effects.base.correction import FlagName, ReadingCorrection
from traverse.kinematics.effects.base.covariate import Covariate, Need
from traverse.kinematics.effects.base.epochs import EffectTime
from traverse.kinematics.kernel.terms import Form, Quantity, Term
from traverse.kinematics.model.geometry import Geometry

if TYPE_CHECKING:
    from traverse.kinematics.arm_file.arm import Effect


@dataclass(frozen=True, slots=True, kw_only=True)
class SingleRate(ReadingCorrection):
    """One value, the same for every joint that it belongs to."""

    per_value: ClassVar[float] = 1.0  # regressor over quantity

    @abstractmethod
    def regressor(self, geometry: Geometry, block: Block) -> Floats:
        """d_alpha for the value 1, (n_chosen, n_samples)."""

    def unit_amounts(self, geometry: Geometry, block: Block) -> Floats:
        """The regressor alone, (1, n_chosen, n_samples)."""
        return self.regressor(geometry, block)[np.newaxis]

    @abstractmethod
    def quantity(self, joint: int) -> Quantity:
        """Factor of a joint's value, besides `per_value`."""

    @property
    def terms(self) -> tuple[Term, ...]:
        """One for every joint."""
        values = (self.per_value * self.values[0],)
        form = Form.READING_RATE
        return tuple(
            Term(form=form, joint=joint, values=values, of=self.quantity(joint))
            for joint in self.affected
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class TimedReading(SingleRate):
    """One reading that changes with time alone."""

    time: EffectTime

    clock: ClassVar[type[EffectTime]]

    @classmethod
    def surroundings(cls, effect: "Effect", setting: EffectContext) -> dict[str, Any]:
        """Take the time."""
        return {"time": cls.clock.from_file(effect, setting)}

    @property
    def needs(self) -> tuple[Need, ...]:
        """The time."""
        return (Need(Covariate.UTC),)

    def flags(self, block: Block) -> Iterator[tuple[FlagName, Booleans]]:
        """Those of the time."""
        return self.time.flags(block)

    def regressor(self, geometry: Geometry, block: Block) -> Floats:
        """Factor of the time, (1, n_samples)."""
        del geometry
        return self.time.amounts(block)[None]

    def quantity(self, joint: int) -> Quantity:
        """Factor of the time."""
        del joint
        return self.time.quantity
