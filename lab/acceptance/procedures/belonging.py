"""Touches that contradict arm file or artefacts by more than any arm is off.

Readings in degrees, lengths in metres, the poses of another arm or campaign: what comes
of them is no error of the arm, and mostly no sphere either, so that it would only be
called incomplete.
"""

from collections.abc import Iterable, Iterator

import numpy as np

from traverse.lab.acceptance.conformity import Figure
from traverse.lab.artefacts import Artefact
from traverse.lab.artefacts.ball_bar import BallBar
from traverse.lab.artefacts.plane import ParallelPlanes, Plane
from traverse.lab.artefacts.sphere import Sphere
from traverse.lab.measured_points.measurement import ArtefactTouches, Measurement

# Of the arm's reach: no arm is off by more.
FARTHEST = 0.01


def contradictions(measured: Measurement, figures: Iterable[Figure]) -> Iterator[str]:
    """Yield what contradicts arm file or artefacts, a clause each.

    Of the figures those with the measurement's tool.
    """
    tool = None if measured.tool is None else measured.tool.name
    most_mm = FARTHEST * measured.reach_mm
    for name, touched in measured.touched.items():
        artefact = measured.artefacts.get(name)
        if artefact is None:
            continue
        parts = [touched.of(feature) for feature in set(touched.features)]
        apart_mm, possible_mm = max(
            ((_extent_mm(part), _width_mm(artefact, part)) for part in parts),
            key=lambda widths: widths[0] - widths[1],
        )
        if apart_mm > possible_mm + most_mm:
            yield (
                f"touches of {name} lie {apart_mm:.1f} mm apart, possible are "
                f"{possible_mm:.1f}"
            )
    for figure in figures:
        if figure.tool == tool and abs(figure.value_mm) > most_mm:
            yield f"{figure.name} is {figure.value_mm:.1f} mm"


def _extent_mm(touched: ArtefactTouches) -> float:
    """Return how far a touch lies from the first, at most."""
    from_first_mm = touched.places_mm - touched.places_mm[0]
    return float(np.linalg.norm(from_first_mm, axis=1).max())


def _width_mm(artefact: Artefact, touched: ArtefactTouches) -> float:
    """Return how far apart the ball's centre can be at one feature."""
    tip_mm = float(touched.tip_mm.mean())
    if isinstance(artefact, Sphere):
        return 2.0 * (float(artefact.radius_mm or np.inf) + tip_mm)
    if isinstance(artefact, BallBar):
        return 2.0 * (float(np.max(artefact.radii_mm)) + tip_mm)
    if isinstance(artefact, Plane | ParallelPlanes):
        return float("inf")
    return 0.0
