"""Deviation of the probe from a nominal place, and conformity with a tolerance."""

from dataclasses import dataclass

import numpy as np

from traverse.client.display.condition import Level
from traverse.protocol.messages.fields import Vector


@dataclass(frozen=True, slots=True)
class Deviation:
    """Deviation from a nominal place.

    Attributes:
        offsets_mm: in x, y, z; None for open coordinates.
        distance_mm: over the coordinates that count.
        expanded_mm: its expanded uncertainty (k = 2); None: unknown.
        doubt: why there is no verdict; empty: there is one.
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
    """A nominal place, in the system that is shown.

    Attributes:
        xyz_mm: None for open coordinates.
    """

    xyz_mm: tuple[float | None, ...]
    tolerance_mm: float

    def deviation(
        self, place_mm: Vector, expanded_mm: float | None, doubt: str = ""
    ) -> Deviation:
        """Return the deviation of a place, with its expanded uncertainty and doubt."""
        offsets_mm = tuple(
            None if nominal is None else measured - nominal
            for measured, nominal in zip(place_mm, self.xyz_mm, strict=True)
        )
        counted = [offset for offset in offsets_mm if offset is not None]
        distance_mm = float(np.linalg.norm(counted))
        return Deviation(offsets_mm, distance_mm, expanded_mm, self.tolerance_mm, doubt)
