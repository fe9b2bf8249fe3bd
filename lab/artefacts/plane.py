"""A plane of unknown attitude, or two parallel ones (the paper's case d).

State: the unit normal n, out of the material, and the height d of the surface.

    w = n . x - d - r, with - r replaced by + r where the direction of touch says
    that the ball was on the other side

Two parallel planes at a known distance are a gauge block or a gap. State: the unit
normal n from plane 1 to plane 2, the height d of their middle and the distance D at the
reference temperature. With growth g and i = -1, +1 for the planes 1 and 2,

    w = n . x - d - i (D (1 + g) / 2 + r) outside, - r inside
"""

from typing import Any, Literal

import numpy as np
from pydantic import Field

from traverse.arrays import Floats
from traverse.kinematics.model.geometry import across
from traverse.lab.artefacts.artefact import (
    PLACE_SCALE_MM,
    Artefact,
    Certificate,
    Equations,
    ExpandingArtefact,
    Length,
    Touches,
    certificate_of,
)
from traverse.lab.artefacts.sphere import offset_sign

_ATTITUDE_SCALE_RAD = 1.0
_STEPS = 10


def tangent_basis(normal: Floats) -> Floats:
    """Make two unit vectors across a unit vector, (2, 3)."""
    return np.stack(across(normal))


def turned_normal(normal: Floats, step: Floats) -> Floats:
    """Move a unit vector by two components in its tangent basis."""
    moved = normal + step @ tangent_basis(normal)
    turned: Floats = moved / np.linalg.norm(moved)
    return turned


def start_normal(centres_mm: Floats, groups: Floats) -> Floats:
    """Fit the common normal of parallel planes, robustly.

    Args:
        centres_mm: (n_poses, 3).
        groups: Index of the plane of each pose, (n_poses,).

    Returns:
        A unit vector; its sign means nothing.
    """
    weights = np.ones(len(centres_mm))
    normal = np.array([0.0, 0.0, 1.0])
    for _ in range(_STEPS):
        local_mm = np.zeros_like(centres_mm)
        for group in np.unique(groups):
            mine = groups == group
            mean_mm = np.average(centres_mm[mine], axis=0, weights=weights[mine])
            local_mm[mine] = centres_mm[mine] - mean_mm
        spread = (weights[:, np.newaxis] * local_mm).T @ local_mm
        normal = np.linalg.eigh(spread)[1][:, 0]
        heights_mm = np.abs(local_mm @ normal)
        scale_mm = max(3.0 * float(np.median(heights_mm)), 1e-9)
        weights = 1.0 / (1.0 + (heights_mm / scale_mm) ** 2)
    return normal


class Plane(Artefact):
    """A flat surface; without directions all balls are taken to be on one side.

    Attributes:
        form_mm: Flatness by its certificate, of a calibrated flat only.
        form_std_mm: Standard uncertainty of that.
    """

    kind: Literal["plane"]
    form_mm: float | None = Field(default=None, ge=0.0)
    form_std_mm: float = Field(default=0.0, ge=0.0)

    def unknown_scales(self, touches: Touches) -> Floats:
        return np.array([_ATTITUDE_SCALE_RAD] * 2 + [PLACE_SCALE_MM])

    def start(self, centres_mm: Floats, touches: Touches) -> Floats:
        """Fit a plane; the directions of touch determine its outside."""
        normal = start_normal(centres_mm, np.zeros(len(centres_mm)))
        if np.nansum(touches.directions @ normal) > 0.0:
            normal = -normal
        sides = _sides(normal, touches)
        if np.ptp(sides) > 0.0:
            # Touched from both sides: two planes of centres, a ball apart.
            refined = start_normal(centres_mm, sides)
            normal = refined * np.sign(refined @ normal)
        sides_mm = _sides(normal, touches) * touches.radius_mm
        return np.append(normal, np.median(centres_mm @ normal - sides_mm))

    def equations(
        self, state: Floats, centres_mm: Floats, touches: Touches
    ) -> Equations:
        """Set up w = n . x - d -+ r."""
        normal = state[:3]
        sides_mm = _sides(normal, touches) * touches.radius_mm
        misclosures_mm = centres_mm @ normal - state[3] - sides_mm
        by_unknowns = np.column_stack(
            [centres_mm @ tangent_basis(normal).T, -np.ones(len(centres_mm))]
        )
        return Equations.of_surface(misclosures_mm, normal, by_unknowns)

    def place(self, state: Floats) -> dict[str, Any]:
        """The outer normal, and its product with any point of the plane."""
        return {"normal": state[:3].tolist(), "offset_mm": float(state[3])}

    def moved(self, state: Floats, step: Floats) -> Floats:
        return np.append(turned_normal(state[:3], step[:2]), state[3] + step[2])


def _sides(normal: Floats, touches: Touches) -> Floats:
    """Return the side of the surface of each ball, +1 along the normal."""
    inwards = touches.directions @ normal
    return np.where(inwards > 0.0, -1.0, 1.0)


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
        return np.array([_ATTITUDE_SCALE_RAD] * 2 + [PLACE_SCALE_MM] * 2)

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
