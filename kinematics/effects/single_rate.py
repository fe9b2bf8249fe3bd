"""Reading corrections of one parameter: d_alpha is it times some regressor."""

from abc import abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Self

import numpy as np

from kinematics.effects.block import Block
from kinematics.effects.correction import Floats, ReadingCorrection
from kinematics.effects.setting import Setting
from kinematics.geometry import Geometry

if TYPE_CHECKING:
    from kinematics.arm_file import Effect


@dataclass(frozen=True, slots=True, kw_only=True)
class SingleRate(ReadingCorrection):
    """One value, the same for every joint that it belongs to."""

    key: ClassVar[str]

    @classmethod
    def from_file(cls, effect: "Effect", setting: Setting) -> Self:
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
