"""The interim check of VDI/VDE 2617-9: a ball bar in seven positions, three times."""

from collections.abc import Iterator

import numpy as np

from traverse.lab.acceptance.conformity.figure import Missing, Part, judged_figure
from traverse.lab.acceptance.conformity.limits import Limits
from traverse.lab.acceptance.procedures.lengths import SET, largest_of, length_sets
from traverse.lab.acceptance.procedures.point_distribution import direction_remarks
from traverse.lab.measured_points.measurement import Measurement

POSITIONS = 7
KEY = "interim_length"
_DEFINITION = (
    "a ball bar in 7 positions, 3 times each: E = L_measured - L_certified, corrected "
    "for expansion; the largest counts"
)


def check_names() -> list[str]:
    """List the ids of all positions."""
    return [f"check-{position}" for position in range(1, POSITIONS + 1)]


def interim_test(measured: Measurement, limits: Limits) -> Iterator[Part]:
    """Interim check: bars `check-1` to `check-7`."""
    sets, problems = length_sets(measured, check_names(), KEY, limits, {SET: str(SET)})
    if problems:
        yield Missing("interim check of length", tuple(problems))
        return
    found = [error for errors in sets for error in errors]
    yield from found
    values = np.array([error.error_mm for error in found])
    worst, budget = largest_of(found, measured, limits)
    within = [float(np.ptp([e.error_mm for e in errors])) for errors in sets]
    yield judged_figure(
        limits,
        KEY,
        "interim check of length",
        _DEFINITION,
        worst.error_mm,
        budget=budget,
        length_mm=worst.length_mm,
        parts=(
            ("mean error", float(values.mean())),
            ("range of all errors", float(np.ptp(values))),
            ("largest range within a position", max(within)),
        ),
        remarks=direction_remarks(measured, check_names()),
    )
