"""A certificate beside what was before: the arm as found, and its previous certificate.

As found is the arm file before an adjustment, as left the one that is certified: both
with the same touches, so that the difference is of the adjustment alone. What changed
since the previous certificate is compared with the uncertainty of both, lines of the
arm included: tests of the same arm differ by so much.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import hypot
from pathlib import Path
from typing import Any

from traverse.kinematics.arm_file.arm import Arm, arm_digest, read_arm
from traverse.lab.acceptance.certificate.digests import digest_values, read_values
from traverse.lab.acceptance.conformity import Verification
from traverse.lab.acceptance.limits import Limits
from traverse.lab.acceptance.standards import verified
from traverse.lab.measured_points.reading import read_by_tool
from traverse.lab.report.quantities import picked
from traverse.strict_toml.problems import FileError

# Their names in the folder `data` of a certificate.
AS_FOUND, PREVIOUS = "as-found.toml", "previous.json"


@dataclass(frozen=True, slots=True, eq=False)
class Before:
    """What a certificate is compared with; None where it is not.

    The arm as found, figures of the same touches with it, and the values of the
    previous `certificate.json`.
    """

    arm: Arm | None = None
    as_found: Verification | None = None
    previous: Mapping[str, Any] | None = None


NOTHING_BEFORE = Before()


def read_before(
    data: Path,
    standard: str,
    limits: Limits,
    arm: Arm,
    *,
    as_found: Path | None,
    previous: Path | None,
) -> Before:
    """Read the arm as found and the previous certificate, of an arm as it was left.

    Raises:
        FileError: One is of another arm or standard, or was altered.
    """
    found_arm = verification = None
    if as_found is not None:
        found_arm = read_arm(as_found)
        known = (None, arm.serial_number)
        if found_arm.name != arm.name or found_arm.serial_number not in known:
            names = f"{found_arm.name} {found_arm.serial_number}"
            raise FileError(as_found, f"is of another arm: {names}")
        verification = verified(read_by_tool(data, found_arm), standard, limits)
    values = None
    if previous is not None:
        values = read_values(previous)
        if problem := _previous_problem(values, standard, arm):
            raise FileError(previous, problem)
    return Before(found_arm, verification, values)


def _previous_problem(values: Mapping[str, Any], standard: str, arm: Arm) -> str | None:
    stated = values["digest"]
    result = {key: value for key, value in values.items() if key != "digest"}
    if digest_values(result, stated["files"])["digest"] != stated.get("digest"):
        return "was altered: its digest is not the one stated"
    try:
        administration = values["administration"]
        names = administration["arm_name"], administration["arm_serial_number"]
        administration["measured_to_utc"]
        list(_changes(values["figures"], values["figures"]))
    except (KeyError, TypeError) as error:
        return f"lacks {error}; make it again with this version of Traverse"
    if values["standard"] != standard:
        return f"is by {values['standard']}, expected {standard}"
    if names != (arm.name, arm.serial_number):
        return f"is of another arm: {' '.join(map(str, names))}"
    return None


def comparison_values(
    before: Before,
    figures: Sequence[Mapping[str, Any]],
    measured_to_utc: str | None,
    *,
    withheld: bool,
) -> dict[str, Any]:
    """Put both comparisons with figures as left into plain values; null without.

    Raises:
        FileError: What was before was measured later.
    """
    as_found = previous = None
    if before.arm is not None and before.as_found is not None:
        as_found = {
            "arm_digest": arm_digest(before.arm),
            "figures": list(_found_figures(before.as_found, withheld=withheld)),
        }
    if before.previous is not None:
        then = before.previous["administration"]["measured_to_utc"]
        if measured_to_utc and then and then > measured_to_utc:
            raise FileError(PREVIOUS, f"was measured later, until {then}")
        previous = {
            "digest": before.previous["digest"]["digest"],
            "measured_to_utc": then,
            "figures": list(_changes(figures, before.previous["figures"])),
        }
    return {"as_found": as_found, "previous": previous}


def _found_figures(
    verification: Verification, *, withheld: bool
) -> Iterator[dict[str, Any]]:
    for figure in verification.figures:
        verdict = figure.decision.verdict if figure.decision else None
        values = picked(figure, "key", "tool", "value_mm")
        yield {**values, "verdict": "withheld" if withheld else verdict}


def _changes(
    figures: Sequence[Mapping[str, Any]], earlier: Sequence[Mapping[str, Any]]
) -> Iterator[dict[str, Any]]:
    """Compare figures with those of the same name then."""
    by_key = {(figure["key"], figure.get("tool")): figure for figure in earlier}
    for figure in figures:
        then = by_key.get((figure["key"], figure.get("tool")))
        if then is None:
            continue
        change_mm = abs(figure["value_mm"]) - abs(then["value_mm"])
        expanded_mm = _expanded_change_mm(figure, then)
        yield {
            "key": figure["key"],
            "tool": figure.get("tool"),
            "value_mm": then["value_mm"],
            "change_mm": change_mm,
            "expanded_change_mm": expanded_mm,
            "changed": None if expanded_mm is None else abs(change_mm) > expanded_mm,
        }


def _expanded_change_mm(*figures: Mapping[str, Any]) -> float | None:
    """Return U of a difference; None where the scatter of the arm is not known."""
    sizes_mm = [
        figure["expanded_with_arm_mm"]
        for figure in figures
        if any(line["of_arm"] for line in figure["budget"])
    ]
    if len(sizes_mm) < len(figures) or None in sizes_mm:
        return None
    return hypot(*sizes_mm)
