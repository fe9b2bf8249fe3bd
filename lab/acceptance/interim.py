"""The interim check of VDI/VDE 2617-9: a ball bar in seven positions, three times."""

from collections.abc import Iterator

import numpy as np

from lab.acceptance.certified import IncompleteError
from lab.acceptance.decision import decision_of
from lab.acceptance.disposition import direction_remarks
from lab.acceptance.figure import Figure, LengthError, Missing, Part
from lab.acceptance.lengths import SET, budget_of, errors_of
from lab.acceptance.limits import Limits
from lab.acceptance.measured import Measured

POSITIONS = 7
KEY = "interim_length"
_DEFINITION = (
    "a ball bar in 7 positions, 3 times each: E = L_measured - L_certified, corrected "
    "for expansion; the largest counts"
)


def check_names() -> list[str]:
    """List the ids of all positions."""
    return [f"check-{position}" for position in range(1, POSITIONS + 1)]


def interim_check(measured: Measured, limits: Limits) -> Iterator[Part]:
    """Interim check: bars `check-1` to `check-7`."""
    problems: list[str] = []
    found: list[LengthError] = []
    for name in check_names():
        try:
            errors = errors_of(measured, name, KEY, limits)
            if len(errors) != SET:
                raise IncompleteError(
                    f"{name}: was measured {len(errors)} times, expected {SET}"
                )
        except IncompleteError as error:
            problems.append(str(error))
            continue
        found += errors
    if problems:
        yield Missing("interim check of length", tuple(problems))
        return
    yield from found
    values = np.array([error.error_mm for error in found])
    worst = found[int(np.argmax(np.abs(values)))]
    budget = budget_of(
        measured.artefacts[worst.artefact], measured.of(worst.artefact), limits
    )
    limit = limits.mpe.of(KEY)
    decision = None
    if limit is not None:
        decision = decision_of(
            worst.error_mm, limit.at(worst.length_mm), budget.standard_mm, limits
        )
    within = [
        float(np.ptp([e.error_mm for e in found if e.artefact == name]))
        for name in check_names()
    ]
    yield Figure(
        KEY,
        "interim check of length",
        _DEFINITION,
        "general knowledge",
        worst.error_mm,
        budget,
        decision,
        (
            ("mean error", float(values.mean())),
            ("range of all errors", float(np.ptp(values))),
            ("largest range within a position", max(within)),
        ),
        tuple(direction_remarks(measured, check_names())),
    )
