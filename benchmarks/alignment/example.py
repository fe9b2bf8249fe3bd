"""The worked example: small residuals on nearly a line, larger ones on a wide net."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.alignment.point_distributions import drawn_rotation
from traverse.arrays import Floats
from traverse.kinematics.helmert.transformation import Helmert
from traverse.kinematics.helmert.volume import Box
from traverse.lab.alignment.best_fit import best_fit_alignment
from traverse.lab.alignment.nominal import fixed_volume
from traverse.lab.alignment.result import alignment_values
from traverse.lab.alignment.touches import CommonPoints, Place

VOLUME = Box(np.zeros(3), np.array([1000.0, 600.0, 400.0]))
NEARLY_A_LINE = np.array(
    [[0.0, 300, 200], [350, 330, 180], [700, 280, 220], [1000, 310, 190]]
)
WIDE = np.array([[0.0, 0, 0], [1000, 0, 350], [0, 600, 400], [1000, 600, 50]])
_STEPS = 20
_N_DRAWS = 500


@dataclass(frozen=True, slots=True, eq=False)
class Example:
    """One of both nets.

    Attributes:
        title: What to call it.
        values: As in alignment.json.
        residual_mm: Root mean square length of the residuals.
        true_mm: Root mean square error in the volume over many measurements of it.
    """

    title: str
    values: dict[str, Any]
    residual_mm: float
    true_mm: float


def examples() -> tuple[Example, Example]:
    """Make both, with the residuals of the paper."""
    return (
        _example("four points nearly on a line", NEARLY_A_LINE, 0.025),
        _example("four points in the corners", WIDE, 0.040),
    )


def _example(title: str, to_mm: Floats, residual_mm: float) -> Example:
    """Scale drawn errors so that the residuals are what is wanted."""
    rng = np.random.default_rng(3)
    true = Helmert(drawn_rotation(rng), rng.uniform(-500.0, 500.0, 3))
    errors = rng.normal(size=to_mm.shape)
    size_mm = residual_mm
    for _ in range(_STEPS):
        values = _aligned(title, to_mm, true, size_mm * errors)
        size_mm *= residual_mm / _residual_mm(values)
    # What such errors do in the mean of many measurements, not just of this one:
    squares = []
    places_mm = VOLUME.mean_mm + (VOLUME.corners_mm - VOLUME.mean_mm) / np.sqrt(3.0)
    # The residuals of n points have 3 n - 6 freedoms.
    std_mm = residual_mm * np.sqrt(len(to_mm) / (3 * len(to_mm) - 6))
    for _ in range(_N_DRAWS):
        drawn = _aligned(title, to_mm, true, rng.normal(0.0, std_mm, to_mm.shape))
        given = drawn["alignment"]
        found = Helmert(np.array(given["rotation"]), np.array(given["translation_mm"]))
        off_mm = found.places_mm(true.inverse().places_mm(places_mm)) - places_mm
        squares.append(np.mean(np.sum(off_mm**2, axis=1)))
    return Example(
        title, values, _residual_mm(values), float(np.sqrt(np.mean(squares)))
    )


def _residual_mm(values: dict[str, Any]) -> float:
    lengths = [point["residual_length_mm"] for point in values["points"]]
    return float(np.sqrt(np.mean(np.square(lengths))))


def _aligned(
    title: str, to_mm: Floats, true: Helmert, errors_mm: Floats
) -> dict[str, Any]:
    from_mm = true.inverse().places_mm(to_mm) + errors_mm
    common = CommonPoints(
        ("A", "B", "C", "D"),
        tuple(Place(place, None) for place in from_mm),
        tuple(Place(place, None) for place in to_mm),
    )
    found = best_fit_alignment(common, fixed_volume(VOLUME), "of the example")
    return alignment_values(found, name=title, arm=None, measured="", nominal="")
