"""A ball bar: two spheres of known radii, at a known distance (case d).

State: centres c_1 and c_2 at the reference temperature. With growth g the bar
stretches about its middle m, c_i(g) = c_i + g (c_i - m), and

    w = |x - c_i(g)| - R_i (1 + g) - r
    certificate: |c_2 - c_1| = D
"""

from typing import Any, Literal

import numpy as np
from pydantic import Field, field_validator

from traverse.arrays import Floats
from traverse.lab.artefacts.artefact import (
    EXACT_MM,
    PLACE_SCALE_MM,
    Artefact,
    Certificate,
    Equations,
    ExpandingArtefact,
    Length,
    Touches,
)
from traverse.lab.artefacts.sphere import (
    distances,
    mirrored_centre,
    start_centre,
)


class BallBar(ExpandingArtefact):
    """Two spheres; state: both centres, then both radii."""

    kind: Literal["ball_bar"]
    radius_mm: float | tuple[float, float]
    radius_std_mm: float | None = Field(default=None, gt=0.0)
    distance_mm: float = Field(gt=0.0)
    distance_std_mm: float | None = Field(default=None, gt=0.0)

    @field_validator("radius_mm")
    @classmethod
    def _radii_above_zero(
        cls, radius_mm: float | tuple[float, float]
    ) -> float | tuple[float, float]:
        if not np.all(np.asarray(radius_mm) > 0.0):
            raise ValueError(f"{radius_mm} is too small; radii are greater than 0")
        return radius_mm

    @property
    def features(self) -> tuple[str, ...]:
        return ("1", "2")

    def fixes_scale(self, touches: Touches) -> bool:
        return bool(self.certified_lengths)

    @property
    def certified_lengths(self) -> dict[str, float]:
        lengths = {"distance_mm": self.distance_mm, "radius_mm": self.radii_mm.mean()}
        stds = {"distance_mm": self.distance_std_mm, "radius_mm": self.radius_std_mm}
        return {n: float(v) for n, v in lengths.items() if stds[n] != float("inf")}

    @property
    def radii_mm(self) -> Floats:
        """Of both spheres, (2,)."""
        return np.broadcast_to(np.asarray(self.radius_mm, dtype=np.float64), (2,))

    def with_contact_shift(self, shift_mm: float) -> Artefact:
        """Shift both certified radii; the distance of the centres stays."""
        first_mm, second_mm = (self.radii_mm + shift_mm).tolist()
        return self.model_copy(update={"radius_mm": (first_mm, second_mm)})

    def unknown_scales(self, touches: Touches) -> Floats:
        return np.array([PLACE_SCALE_MM] * 8)

    def start(self, centres_mm: Floats, touches: Touches) -> Floats:
        """Fit two spheres; one that was not touched is placed near them."""
        middle_mm = centres_mm.mean(axis=0)
        places = np.array(
            [middle_mm, middle_mm + np.array([self.distance_mm, 0.0, 0.0])]
        )
        radii_mm = self.radii_mm.copy()
        for index in range(2):
            mine = touches.features == index
            if np.any(mine):
                known = "radius_mm" in self.certified_lengths
                around_mm = float(radii_mm[index]) + touches.radius_mm
                places[index], found_mm = start_centre(
                    centres_mm[mine], around_mm if known else None
                )
                radii_mm[index] = found_mm - touches.radius_mm
        return np.concatenate([places.ravel(), radii_mm])

    def mirror_images(
        self, state: Floats, centres_mm: Floats, touches: Touches
    ) -> tuple[Floats, ...]:
        """Mirror one ball, the other, and both."""
        mirrored = []
        for index in range(2):
            mine = centres_mm[touches.features == index]
            around_mm = float(state[6 + index]) + touches.radius_mm
            other_mm = mirrored_centre(
                mine, state[3 * index : 3 * index + 3], around_mm
            )
            if other_mm is None:
                continue
            image = state.copy()
            image[3 * index : 3 * index + 3] = other_mm
            mirrored.append(image)
        if len(mirrored) == 2:
            both = np.concatenate([mirrored[0][:3], mirrored[1][3:]])
            mirrored.append(both)
        return tuple(mirrored)

    def equations(
        self, state: Floats, centres_mm: Floats, touches: Touches
    ) -> Equations:
        """Set up w = |x - c_i(g)| - R_i (1 + g) - r."""
        places_mm = state[:6].reshape(2, 3)
        mine = touches.features
        half = 0.5 * touches.growths[:, np.newaxis]
        grown_mm = places_mm[mine] + half * (places_mm[mine] - places_mm[1 - mine])
        distances_mm, units = distances(centres_mm, grown_mm)
        growths = 1.0 + touches.growths
        radii_mm = state[6:][mine] * growths
        by_unknowns = np.zeros((len(centres_mm), 8))
        rows = np.arange(len(centres_mm))
        for component in range(3):
            unit = units[:, component]
            by_unknowns[rows, 3 * mine + component] = -unit * (1.0 + half[:, 0])
            by_unknowns[rows, 3 * (1 - mine) + component] = unit * half[:, 0]
        by_unknowns[rows, 6 + mine] = -growths
        misclosures_mm = distances_mm - radii_mm - touches.radius_mm
        return Equations.of_surface(misclosures_mm, units, by_unknowns)

    def certificate(self, state: Floats, touches: Touches) -> Certificate:
        distance = self.lengths(state)[0]
        by_unknowns = np.zeros((3, 8))
        by_unknowns[0] = distance.by_unknowns
        by_unknowns[1, 6] = by_unknowns[2, 7] = 1.0
        distance_mm = distance.value_mm - self.distance_mm
        radius_std_mm = self.radius_std_mm or EXACT_MM
        return Certificate(
            np.array([distance_mm, *(state[6:] - self.radii_mm)]),
            by_unknowns,
            np.array([self.distance_std_mm or EXACT_MM, radius_std_mm, radius_std_mm]),
        )

    def place(self, state: Floats) -> dict[str, Any]:
        return {"centres_mm": state[:6].reshape(2, 3).tolist()}

    def lengths(self, state: Floats) -> tuple[Length, ...]:
        """The distance; the radius of the first sphere where it is not certified."""
        along_mm = state[3:6] - state[:3]
        distance_mm = float(np.linalg.norm(along_mm))
        unit = along_mm / max(distance_mm, 1e-9)
        by_unknowns = np.concatenate([-unit, unit, np.zeros(2)])
        distance = Length("distance_mm", distance_mm, by_unknowns, 0)
        if self.radius_std_mm != float("inf"):
            return (distance,)
        return (distance, Length("radius_mm", float(state[6]), np.eye(8)[6], None))
