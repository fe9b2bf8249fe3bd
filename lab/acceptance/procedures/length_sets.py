"""Errors of many lengths, each measured as often as its test wants it."""

from collections.abc import Sequence

from traverse.lab.acceptance.conformity.figure import LengthError
from traverse.lab.acceptance.conformity.limits import Limits
from traverse.lab.acceptance.conformity.uncertainty_budget import Budget
from traverse.lab.acceptance.procedures.lengths import budget_of, errors_of
from traverse.lab.measured_points.certified_values import IncompleteError
from traverse.lab.measured_points.measurement import Measurement


def length_sets(
    measured: Measurement,
    names: Sequence[str],
    key: str,
    limits: Limits,
    times: dict[int, str],
) -> tuple[list[list[LengthError]], list[str]]:
    """Measure lengths.

    Args:
        measured: All touches.
        names: Ids of the artefacts.
        key: Of the figure.
        limits: With what else is known of the standards.
        times: How often each may have been measured, with the words for it.

    Returns:
        The errors by artefact, and what is missing.
    """
    sets: list[list[LengthError]] = []
    problems: list[str] = []
    for name in names:
        try:
            errors = errors_of(measured, name, key, limits)
            if len(errors) not in times:
                raise IncompleteError(
                    f"{name}: was measured {len(errors)} times, expected "
                    f"{', or '.join(times.values())}"
                )
        except IncompleteError as error:
            problems.append(str(error))
            continue
        sets.append(errors)
    return sets, problems


def largest_of(
    errors: Sequence[LengthError], measured: Measurement, limits: Limits
) -> tuple[LengthError, Budget]:
    """Take the error of the largest size, whatever its sign, and its uncertainty."""
    largest = max(errors, key=lambda error: abs(error.error_mm))
    name = largest.artefact
    return largest, budget_of(measured.artefacts[name], measured.of(name), limits)
