"""What must be established before an alignment is good."""

from collections.abc import Sequence
from dataclasses import dataclass

from traverse.lab.outcomes.base import (
    Condition,
    Established,
    Finding,
    Outcome,
    Shortfall,
    State,
    judge,
)

TITLES = {
    State.GOOD: "Usable",
    State.DOUBT: "Usable with reservations",
    State.BAD: "Not usable",
}


@dataclass(frozen=True, slots=True)
class AlignmentEvidence:
    """Figures of an alignment that its conditions look at.

    Attributes:
        p_value: Of the global test; None where nothing is redundant or stated.
        passed: Whether it passed, likewise.
        warnings: Code and sentence of what is weak about it.
    """

    sigma0: float | None
    redundancy: int
    p_value: float | None
    passed: bool | None
    warnings: Sequence[tuple[str, str]]


_TESTED = ("no_redundancy", "errors_not_stated", "global_test_failed")


def _sentence(text: str) -> str:
    return f"{text[0].upper()}{text[1:].strip()}."


def _tested(evidence: AlignmentEvidence) -> Finding:
    values = {
        "sigma0": evidence.sigma0,
        "redundancy": evidence.redundancy,
        "p_value": evidence.p_value,
    }
    state = State.BAD if evidence.passed is False else State.DOUBT
    shortfalls = [
        Shortfall(_sentence(text), "", {**values, "flag": code}, state)
        for code, text in evidence.warnings
        if code in _TESTED
    ]
    if evidence.passed and not shortfalls:
        return Established(values)
    return shortfalls


def _well_placed(evidence: AlignmentEvidence) -> Finding:
    return [
        Shortfall(_sentence(text), "", {"flag": code})
        for code, text in evidence.warnings
        if code not in _TESTED
    ] or Established()


CONDITIONS: tuple[Condition[AlignmentEvidence], ...] = (
    Condition("tested", "residuals are as large as the stated errors allow", _tested),
    Condition("points", "points determine it well and fit each other", _well_placed),
)


def alignment_outcome(evidence: AlignmentEvidence) -> Outcome:
    return judge(CONDITIONS, evidence)
