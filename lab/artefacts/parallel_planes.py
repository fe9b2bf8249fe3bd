"""Two parallel planes at a known distance: a gauge block or a gap (case d).

State: the unit normal n from plane 1 to plane 2, the height d of their middle and
the distance D at the reference temperature. With growth g and i = -1, +1 for the
planes 1 and 2,

    w = n . x - d - i (D (1 + g) / 2 + r) outside, - r inside
"""

from typing import Any, Literal

import numpy as np
from pydantic import Field

from traverse.arrays import Floats
from traverse.lab.artefacts.artefact import (
    Artefact,
    Certificate,
    Equations,
    ExpandingArtefact,
    Length,
    Touches,
    certificate_of,
)
from traverse.lab.artefacts.plane import (
    ATTITUDE_SCALE_RAD,
    HEIGHT_SCALE_MM,
    start_normal,
    tangent_basis,
    turned_normal,
)
from traverse.lab.artefacts.sphere import offset_sign


class ParallelPlanes(ExpandingArtefact):
    """A pair of parallel surfaces; state: normal, middle height, distance."""

    kind: Literal["parallel_planes"]
    distance_mm: float = Field(gt=0.0)
    distance_std_mm: float | None = Field(default=None, gt=0.0)
    side: Literal["outside", "inside"] = "outside"

    @property
    def features(self) -> tuple[str, ...]:
        return ("1", "2")

    def fixes_scale(self, touches: Touches) -> bool:
        """Return whether both were touched: their distance is the length."""
        both = len(np.unique(touches.features)) == 2
        return both and bool(self.certified_lengths)

    @property
    def certified_lengths(self) -> dict[str, float]:
        known = self.distance_std_mm != float("inf")
        return {"distance_mm": self.distance_mm} if known else {}

    def with_contact_shift(self, shift_mm: float) -> Artefact:
        distance_mm = self.distance_mm + 2.0 * offset_sign(self.side) * shift_mm
        return self.model_copy(update={"distance_mm": distance_mm})

    def unknown_scales(self, touches: Touches) -> Floats:
        return np.array([ATTITUDE_SCALE_RAD] * 2 + [HEIGHT_SCALE_MM] * 2)

    def start(self, centres_mm: Floats, touches: Touches) -> Floats:
        normal = start_normal(centres_mm, touches.features.astype(np.float64))
        signs = 2.0 * touches.features - 1.0
        heights_mm = centres_mm @ normal
        both = np.any(signs < 0.0) and np.any(signs > 0.0)
        if both and np.median(heights_mm[signs > 0.0]) < np.median(
            heights_mm[signs < 0.0]
        ):
            normal, heights_mm = -normal, -heights_mm
        offset_mm = offset_sign(self.side) * touches.radius_mm
        middles_mm = heights_mm - signs * (0.5 * self.distance_mm + offset_mm)
        return np.array([*normal, float(np.median(middles_mm)), self.distance_mm])

    def equations(
        self, state: Floats, centres_mm: Floats, touches: Touches
    ) -> Equations:
        """Set up w = n . x - d - i (D (1 + g) / 2 +- r)."""
        normal = state[:3]
        signs = 2.0 * touches.features - 1.0
        halves = 0.5 * (1.0 + touches.growths)
        offset_mm = offset_sign(self.side) * touches.radius_mm
        misclosures_mm = (
            centres_mm @ normal - state[3] - signs * (halves * state[4] + offset_mm)
        )
        turned_mm = centres_mm @ tangent_basis(normal).T
        by_sizes = -np.ones(len(centres_mm)), -signs * halves
        by_unknowns = np.column_stack([turned_mm, *by_sizes])
        return Equations.of_surface(misclosures_mm, normal, by_unknowns)

    def certificate(self, state: Floats, touches: Touches) -> Certificate:
        std_mm = self.distance_std_mm
        return certificate_of(self.lengths(state), [self.distance_mm], [std_mm])

    def lengths(self, state: Floats) -> tuple[Length, ...]:
        by_unknowns = np.array([0.0, 0.0, 0.0, 1.0])
        return (Length("distance_mm", float(state[4]), by_unknowns, 0),)

    def place(self, state: Floats) -> dict[str, Any]:
        """The normal from plane 1 to 2, and its products with points of each."""
        halves_mm = np.array([-0.5, 0.5]) * state[4]
        offsets_mm = (state[3] + halves_mm).tolist()
        return {"normal": state[:3].tolist(), "offsets_mm": offsets_mm}

    def moved(self, state: Floats, step: Floats) -> Floats:
        return np.concatenate(
            [turned_normal(state[:3], step[:2]), state[3:] + step[2:]]
        )
