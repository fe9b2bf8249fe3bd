"""How far the probe is from a nominal place, and whether that is within a tolerance."""

from dataclasses import dataclass

import numpy as np

from traverse.client.display.condition import Level
from traverse.protocol.messages.fields import Vector


@dataclass(frozen=True, slots=True)
class Deviation:
    """From a nominal place.

    Attributes:
        offsets_mm: in x, y, z; None where the nominal place leaves that open.
        distance_mm: over the coordinates that count.
        expanded_mm: its expanded uncertainty (k = 2); None: unknown.
        tolerance_mm: permitted distance.
        doubt: why there is no verdict, whatever the distance; empty: there is one.
    """

    offsets_mm: tuple[float | None, ...]
    distance_mm: float
    expanded_mm: float | None
    tolerance_mm: float
    doubt: str = ""

    @property
    def decision(self) -> tuple[Level, str]:
        """By ISO 14253-1: nothing is proved within the uncertainty of the limit."""
        if self.doubt:
            return "warning", f"no verdict: {self.doubt}"
        is_in = self.distance_mm <= self.tolerance_mm
        if self.expanded_mm is None:
            where = "inside" if is_in else "outside"
            return "warning", f"{where} by its value alone: U is not known"
        if abs(self.distance_mm - self.tolerance_mm) < self.expanded_mm:
            return "warning", "undecided: within U of the limit"
        return ("good", "in tolerance") if is_in else ("bad", "out of tolerance")


@dataclass(frozen=True, slots=True)
class Nominal:
    """Where something should be, in the system that is shown.

    Attributes:
        xyz_mm: None where a coordinate does not matter.
        tolerance_mm: permitted distance from there.
    """

    xyz_mm: tuple[float | None, ...]
    tolerance_mm: float

    def deviation(
        self, place_mm: Vector, expanded_mm: float | None, doubt: str = ""
    ) -> Deviation:
        """Of a place, with its expanded uncertainty, and what makes it doubtful."""
        offsets_mm = tuple(
            None if wanted is None else measured - wanted
            for measured, wanted in zip(place_mm, self.xyz_mm, strict=True)
        )
        counted = [offset for offset in offsets_mm if offset is not None]
        distance_mm = float(np.linalg.norm(counted))
        return Deviation(offsets_mm, distance_mm, expanded_mm, self.tolerance_mm, doubt)
