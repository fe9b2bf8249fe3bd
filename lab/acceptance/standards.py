"""The standards by their names in commands, and the requirements of each.

What belongs to which test is said by the ids of the artefacts in `campaign.toml`, and
by features; docs/acceptance.md lists them.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from traverse.lab.acceptance.conformity import (
    Figure,
    LengthError,
    Missing,
    Part,
    Scatter,
    Verification,
    with_tool,
)
from traverse.lab.acceptance.limits import NO_LIMITS, Limits
from traverse.lab.acceptance.procedures.b89 import articulation, volumetric
from traverse.lab.acceptance.procedures.belonging import contradictions
from traverse.lab.acceptance.procedures.length_tests import interim_test, length_test
from traverse.lab.acceptance.procedures.probing import (
    effective_diameter,
    location,
    size_and_form,
)
from traverse.lab.acceptance.procedures.scanning import scanning
from traverse.lab.measured_points.measurement import Measurement

Tests = Callable[[Measurement, Limits], Iterator[Part]]

PROBING = ("probing-1", "probing-2")
LOCATION = "articulated"
DIAMETER = "diameter"


@dataclass(frozen=True, slots=True)
class Standard:
    """A standard with its tests.

    Attributes:
        remarks: What every certificate by it says.
    """

    title: str
    tests: Tests
    remarks: tuple[str, ...] = ()


def _iso10360(measured: Measurement, limits: Limits) -> Iterator[Part]:
    yield from size_and_form(measured, PROBING, limits)
    yield from location(measured, LOCATION, limits)
    yield from length_test(measured, "e_uni", limits)
    yield from length_test(measured, "e_bi", limits)


def _b89(measured: Measurement, limits: Limits) -> Iterator[Part]:
    yield from effective_diameter(measured, DIAMETER, limits)
    yield from articulation(measured, limits)
    yield from volumetric(measured, limits)


STANDARDS: Mapping[str, Standard] = {
    "iso10360-12": Standard("ISO 10360-12:2016", _iso10360),
    "asme-b89.4.22": Standard("ASME B89.4.22", _b89),
    "vdi2617-9": Standard("VDI/VDE 2617-9, interim check", interim_test),
    "iso10360-8": Standard(
        "ISO 10360-8:2013",
        scanning,
        (
            "ISO 10360-8 is written for Cartesian machines; to an arm it applies by "
            "mutual agreement of both parties",
        ),
    ),
}


def verified(
    measured: Sequence[Measurement], standard: str, limits: Limits = NO_LIMITS
) -> Verification:
    """Compute all figures of one of `STANDARDS`, and decide on those with a limit.

    An arm is tested with each tool by itself: no figure is of touches with several.
    """
    chosen = STANDARDS[standard]
    parts = [
        part if measurement.tool is None else with_tool(part, measurement.tool.name)
        for measurement in measured
        for part in chosen.tests(measurement, limits)
    ]
    notes = dict.fromkeys(
        note for measurement in measured for note in measurement.notes
    )
    lengths = tuple(part for part in parts if isinstance(part, LengthError))
    from traverse.lab.acceptance.procedures.predicted_lengths import (  # noqa: PLC0415 - it needs scipy, of which a plan is made without
        predicted_lengths,
    )

    figures = tuple(part for part in parts if isinstance(part, Figure))
    return Verification(
        standard,
        chosen.title,
        figures,
        tuple(part for part in parts if isinstance(part, Missing)),
        lengths,
        tuple(part for part in parts if isinstance(part, Scatter)),
        (*chosen.remarks, *notes, *_not_stated(parts)),
        # With several tools no touch has a stated uncertainty.
        predicted_lengths(measured[0], lengths),
        tuple(
            clause
            for measurement in measured
            for clause in contradictions(measurement, figures)
        ),
    )


def _not_stated(parts: list[Part]) -> Iterator[str]:
    """Return which decisions fail for want of an uncertainty, and where to state it."""
    names: dict[str, dict[str, None]] = {}
    for part in parts:
        if isinstance(part, Figure) and part.decision is not None:
            for budget in (part.budget, *part.model.budgets):
                for line in budget.lines:
                    if line.standard_mm is None:
                        gap = f"{line.name}: {line.formula}"
                        names.setdefault(gap, {})[part.name] = None
    for gap, figures in names.items():
        of_figures = ", ".join(figures)
        yield (
            f"no uncertainty is stated for {of_figures} ({gap}), so nothing is decided"
        )
