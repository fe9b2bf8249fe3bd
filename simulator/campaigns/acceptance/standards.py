"""Standards of acceptance tests, as the simulator has them."""

from typing import Literal

import numpy as np

from traverse.arrays import Floats
from traverse.simulator.campaigns.artefacts import Cone, Points, Sphere
from traverse.simulator.campaigns.artefacts.artefact import Table
from traverse.simulator.campaigns.artefacts.placement import Placement


class CalibratedSphere(Sphere):
    """A calibrated sphere whose touches have names of groups.

    Attributes:
        groups: The features.
    """

    kind: Literal["sphere"] = "sphere"
    known: bool = True
    groups: tuple[str, ...] = ("",)

    @property
    def features(self) -> tuple[str, ...]:
        """Names of the groups."""
        return self.groups


class SidedCone(Cone):
    """A seat that is touched with the elbow to either side."""

    kind: Literal["cone"] = "cone"

    @property
    def features(self) -> tuple[str, ...]:
        """Where the elbow is."""
        return ("left", "right")


class SeatBar(Points):
    """A bar with a seat at each end.

    Attributes:
        length_mm: True distance of the seats.
        length_std_mm: Of the distance that the campaign states.
    """

    kind: Literal["points"] = "points"
    n_points: int = 2
    size_mm: float = 1.0
    length_mm: float
    length_std_mm: float = 0.0

    @property
    def features(self) -> tuple[str, ...]:
        """The two seats."""
        return ("a", "b")

    @property
    def own_mm(self) -> Floats:
        """The seats, (2, 3), along the third axis."""
        ends = np.zeros((2, 3))
        ends[:, 2] = -0.5 * self.length_mm, 0.5 * self.length_mm
        return ends

    def stated(self, rng: np.random.Generator, placement: Placement) -> Table:
        """Its length, as the certificate has it: each end has its part of the error."""
        ends_mm = self.own_mm
        ends_mm[1, 2] += self.length_std_mm * float(rng.standard_normal())
        table: Table = {"frame": "own"}
        if self.length_std_mm > 0.0:
            table["points_std_mm"] = self.length_std_mm / float(np.sqrt(2.0))
        if self.expansion_per_c:
            table["expansion_per_c"] = self.expansion_per_c
        names = dict(zip(self.features, ends_mm.tolist(), strict=True))
        return {**table, "points_mm": names}
