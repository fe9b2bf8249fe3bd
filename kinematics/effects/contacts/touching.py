"""What the contact corrections share: they need the direction of the surface."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Self

import numpy as np

from traverse.arrays import Booleans
from traverse.kinematics.effects.base.block import Block
from traverse.kinematics.effects.base.context import EffectContext
from traverse.kinematics.effects.base.correction import ContactCorrection, FlagName

if TYPE_CHECKING:
    from traverse.kinematics.arm_file.arm import Effect


@dataclass(frozen=True, slots=True, kw_only=True)
class Touching(ContactCorrection):
    """A few values of the probe as a whole."""

    names: ClassVar[tuple[str, ...]]

    @classmethod
    def from_file(cls, effect: "Effect", setting: EffectContext) -> Self:
        """Build it from an entry of `[[effects]]`."""
        del setting
        values = effect.values
        return cls(joints=slice(0, 0), values=tuple(values[n] for n in cls.names))

    @property
    def parameters(self) -> tuple[str, ...]:
        """Keys of the arm file."""
        return self.names

    def flags(self, block: Block) -> Iterator[tuple[FlagName, Booleans]]:
        """Flag where the surface is unknown, and nothing could be corrected."""
        if block.directions is None:
            yield "surface_unknown", np.ones(len(block), dtype=np.bool_)
        else:
            x, y, z = np.isnan(block.directions).T
            yield "surface_unknown", x | y | z
