"""Base of the contact corrections, which need the direction of the surface."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from traverse.arrays import Booleans
from traverse.kinematics.effects.base.block import Block
from traverse.kinematics.effects.base.correction import ContactCorrection, FlagName


@dataclass(frozen=True, slots=True, kw_only=True)
class Touching(ContactCorrection):
    """A few values of the probe as a whole."""

    def flags(self, block: Block) -> Iterator[tuple[FlagName, Booleans]]:
        """Flag where the surface is unknown, and nothing could be corrected."""
        if block.directions is None:
            yield "surface_unknown", np.ones(len(block), dtype=np.bool_)
        else:
            x, y, z = np.isnan(block.directions).T
            yield "surface_unknown", x | y | z
