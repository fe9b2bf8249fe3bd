"""A plane of unknown attitude (the paper's case d).

State: the unit normal n, out of the material, and the height d of the surface.

    w = n . x - d - r, with - r replaced by + r where the direction of touch says
    that the ball was on the other side

The attitude that turns, and its start, serve parallel planes too.
"""

from typing import Any, Literal

import numpy as np
from pydantic import Field

from traverse.arrays import Floats
from traverse.kinematics.model.geometry import across
from traverse.lab.artefacts.artefact import Artefact, Equations, Touches

ATTITUDE_SCALE_RAD = 1.0
HEIGHT_SCALE_MM = 1000.0
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
        return np.array([ATTITUDE_SCALE_RAD] * 2 + [HEIGHT_SCALE_MM])

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
