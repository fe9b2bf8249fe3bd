"""Lengths in seven positions, three times each: E_UNI and E_BI, the interim check.

E_UNI and E_BI are of five lengths. Rule for repeats, as of ISO 10360 [K]: of at most
five of the 35 sets of three one error may exceed the acceptance limit; that length is
measured ten times again in the same place, and all ten must be inside.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from traverse.lab.acceptance.conformity import (
    Decision,
    Figure,
    LengthError,
    Part,
    Verdict,
    decision_of,
    guard_of,
    judged_figure,
    rule_text,
    worst,
)
from traverse.lab.acceptance.limits import Limits
from traverse.lab.acceptance.procedures.lengths import (
    SET,
    largest_of,
    length_sets,
    model_of,
    repeatability_of,
)
from traverse.lab.acceptance.procedures.point_distribution import direction_remarks
from traverse.lab.measured_points.measurement import SCANNED, Measurement

POSITIONS, LENGTHS = 7, 5
AGAIN = 10
MOST_SETS = 5
LEAST_SHARE = 0.66
DEFINITION = (
    "5 lengths in 7 positions, 3 times each: 105 errors E = L_measured - L_certified, "
    "corrected for expansion; the largest counts, all must be within the limit. The "
    "longest length at least 66 % of the measuring range. Repeats: in at most 5 of the "
    "35 sets of three one error may be outside; it is measured 10 times again, all in"
)


# Title, prefix of the artefacts' ids, and what the lengths lie between.
LENGTH_TESTS = {
    "e_uni": ("E_UNI", "uni", "from centre to centre, probed alike: unidirectional"),
    "e_bi": ("E_BI", "bi", "between opposite faces: bidirectional"),
    "scan_e_uni": (
        "E_Uni, scanned",
        f"{SCANNED}uni",
        "between centres of scanned balls: unidirectional",
    ),
    "scan_e_bi": (
        "E_Bi, scanned",
        f"{SCANNED}bi",
        "between opposite faces, scanned: bidirectional",
    ),
}


def length_names(prefix: str) -> list[str]:
    """List the ids of all 35 sets: position, then length."""
    return [
        f"{prefix}-{position}-{length}"
        for position in range(1, POSITIONS + 1)
        for length in range(1, LENGTHS + 1)
    ]


def length_test(measured: Measurement, key: str, limits: Limits) -> Iterator[Part]:
    """One of `LENGTH_TESTS`; all but E_UNI if an artefact or a limit asks for it."""
    title, prefix, _ = LENGTH_TESTS[key]
    named = any(name.startswith(f"{prefix}-") for name in measured.artefacts)
    if key != "e_uni" and not named and limits.mpe.of(key) is None:
        return
    times = {SET: str(SET), SET + AGAIN: f"{SET + AGAIN} with ten again"}
    sets, parts = length_sets(
        measured, length_names(prefix), key, limits, times, title=title
    )
    yield from parts
    if sets:
        yield _figure(measured, key, sets, limits)


def _figure(
    measured: Measurement, key: str, sets: Sequence[list[LengthError]], limits: Limits
) -> Figure:
    counted = [error for errors in sets for error in errors[:SET]]
    largest = largest_of(counted)
    verdict, remarks = _judged(sets, limits)
    decision = None
    if verdict is not None and largest.limit_mm is not None:
        guard_mm = guard_of(largest.standard_mm, limits)
        decision = Decision(verdict, largest.limit_mm, guard_mm, rule_text(limits))
    values = np.array([error.error_mm for error in counted])
    return Figure(
        key,
        LENGTH_TESTS[key][0],
        f"{DEFINITION}. Lengths {LENGTH_TESTS[key][2]}",
        "general knowledge",
        largest.error_mm,
        largest.budget.with_lines(repeatability_of([errors[:SET] for errors in sets])),
        decision,
        model_of(counted),
        (
            ("mean error", float(values.mean())),
            ("standard deviation", float(values.std(ddof=1))),
            ("largest error", float(values.max())),
            ("smallest error", float(values.min())),
        ),
        (
            *remarks,
            *_count_remarks(counted),
            *direction_remarks(measured, [errors[0].artefact for errors in sets]),
        ),
    )


def _judged(
    sets: Sequence[list[LengthError]], limits: Limits
) -> tuple[Verdict | None, list[str]]:
    """Apply the rule for repeats to sets of 3, or 3 and ten again."""
    outside: list[tuple[list[LengthError], Verdict, bool]] = []
    remarks: list[str] = []
    too_many = False
    for errors in sets:
        verdicts: list[Verdict] = []
        for error in errors:
            if error.limit_mm is None:
                return None, remarks
            measured = error.error_mm, error.limit_mm, error.standard_mm
            verdicts.append(decision_of(*measured, limits).verdict)
        if "undecided" in verdicts:
            return "undecided", remarks
        bad = [row for row in range(SET) if verdicts[row] != "accept"]
        again = verdicts[SET:]
        cured = len(bad) == 1 and len(again) == AGAIN and set(again) == {"accept"}
        too_many = too_many or len(bad) > 1
        if bad:
            outside.append((errors, worst(verdicts), cured))
    if not outside:
        return "accept", remarks
    open_ = [entry for entry in outside if not entry[2]]
    if not open_ and len(outside) <= MOST_SETS:
        names = ", ".join(errors[0].artefact for errors, _, _ in outside)
        remarks.append(f"one error outside in {names}: measured ten times again, good")
        return "accept", remarks
    may = not too_many and len(outside) <= MOST_SETS
    if may and open_ and all(len(errors) == SET for errors, _, _ in open_):
        names = ", ".join(errors[0].artefact for errors, _, _ in open_)
        remarks.append(
            f"one error outside in {names}: measure each ten times again in the same "
            "place; until then nothing is decided"
        )
        return "neither", remarks
    remarks.append(f"errors outside in {len(outside)} of {len(sets)} sets")
    return worst([verdict for _, verdict, _ in outside]), remarks


def _count_remarks(counted: Sequence[LengthError]) -> Iterator[str]:
    lengths = {round(error.length_mm, 1) for error in counted}
    if len(lengths) < LENGTHS:
        yield f"{len(lengths)} different lengths, expected {LENGTHS}"


INTERIM = "interim_length"
_INTERIM_DEFINITION = (
    "a ball bar in 7 positions, 3 times each: E = L_measured - L_certified, corrected "
    "for expansion; the largest counts"
)


def check_names() -> list[str]:
    """List the ids of all positions of the interim check."""
    return [f"check-{position}" for position in range(1, POSITIONS + 1)]


def interim_test(measured: Measurement, limits: Limits) -> Iterator[Part]:
    """Interim check of VDI/VDE 2617-9: bars `check-1` to `check-7`."""
    title = "interim check of length"
    sets, parts = length_sets(
        measured, check_names(), INTERIM, limits, {SET: str(SET)}, title=title
    )
    yield from parts
    if not sets:
        return
    counted = [error for errors in sets for error in errors]
    values = np.array([error.error_mm for error in counted])
    worst = largest_of(counted)
    within = [float(np.ptp([e.error_mm for e in errors])) for errors in sets]
    yield judged_figure(
        limits,
        INTERIM,
        title,
        _INTERIM_DEFINITION,
        worst.error_mm,
        budget=worst.budget.with_lines(repeatability_of(sets)),
        model=model_of(counted),
        lengths_mm=[error.length_mm for error in counted],
        parts=(
            ("mean error", float(values.mean())),
            ("range of all errors", float(np.ptp(values))),
            ("largest range within a position", max(within)),
        ),
        remarks=direction_remarks(measured, check_names()),
    )
