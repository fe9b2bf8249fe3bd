"""Types of `compiled.pyx`, which explains them."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from traverse.kinematics.effects.base.block import Block
from traverse.kinematics.kernel.terms import Term
from traverse.kinematics.model.geometry import Geometry

Floats = NDArray[np.float64]
Vector = tuple[float, float, float]

LARGEST_N_JOINTS: int

def runnable_variants() -> tuple[str, ...]: ...

class Chain:
    def __init__(self, geometry: Geometry, variant: str) -> None: ...
    @property
    def variant(self) -> str: ...
    def poses(
        self,
        angles_rad: Floats,
        centres_mm: Floats | None = None,
        directions: Floats | None = None,
    ) -> tuple[Floats, Floats]: ...
    def centres(self, angles_rad: Floats, out: Floats | None = None) -> Floats: ...
    def positions(self, angles_rad: Floats, out: Floats | None = None) -> Floats: ...
    def joint_poses(
        self,
        angles_rad: Floats,
        positions_mm: Floats | None = None,
        rotations: Floats | None = None,
    ) -> tuple[Floats, Floats]: ...
    def derivatives(
        self,
        angles_rad: Floats,
        out: tuple[Floats, Floats, Floats, Floats] | None = None,
    ) -> tuple[Floats, Floats, Floats, Floats]: ...
    def pose(self, angles_rad: Sequence[float] | Floats) -> tuple[Vector, Vector]: ...
    def centre(self, angles_rad: Sequence[float] | Floats) -> Vector: ...

class DeflectedChain:
    def __init__(
        self,
        geometry: Geometry,
        variant: str,
        terms: Sequence[Term],
        levers_kg_m: Floats,
    ) -> None: ...
    @property
    def variant(self) -> str: ...
    def poses(
        self,
        block: Block,
        gravity_m_s2: Sequence[float],
        centres_mm: Floats | None = None,
        directions: Floats | None = None,
    ) -> tuple[Floats, Floats]: ...
