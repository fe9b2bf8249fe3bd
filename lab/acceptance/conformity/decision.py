"""Conformity of a figure with its limit.

With u the standard uncertainty of the test value, g the guard factor, MPE the limit:

    rule         accept               reject               neither
    iso14253-1   |e| <= MPE - g u     |e| > MPE + g u      between
    simple       |e| <= MPE           |e| > MPE            never

Between the guard bands neither conformity nor its opposite is proved: who has to prove
loses (the supplier cannot prove conformity, nor the customer the opposite).
"""

from dataclasses import dataclass
from typing import Literal

from traverse.lab.acceptance.conformity.limits import Limits

Verdict = Literal["accept", "reject", "neither"]


@dataclass(frozen=True, slots=True)
class Decision:
    """What was decided, and by which rule.

    Attributes:
        verdict: accept, reject or neither.
        limit_mm: The maximum permissible error.
        guard_mm: Width of the guard band; 0 with simple acceptance.
        rule: In words.
    """

    verdict: Verdict
    limit_mm: float
    guard_mm: float
    rule: str


def decision_of(
    error_mm: float, limit_mm: float, standard_mm: float, limits: Limits
) -> Decision:
    """Decide on one error.

    Args:
        error_mm: Signed or not.
        limit_mm: The maximum permissible error.
        standard_mm: Standard uncertainty of the test value.
        limits: Name the rule.
    """
    guard_mm = guard_of(standard_mm, limits)
    size_mm = abs(error_mm)
    verdict: Verdict = "neither"
    if size_mm <= limit_mm - guard_mm:
        verdict = "accept"
    elif size_mm > limit_mm + guard_mm:
        verdict = "reject"
    return Decision(verdict, limit_mm, guard_mm, rule_text(limits))


def guard_of(standard_mm: float, limits: Limits) -> float:
    """Say how wide the guard band is."""
    if limits.decision == "simple":
        return 0.0
    return limits.guard_factor * standard_mm


def rule_text(limits: Limits) -> str:
    """Say the rule in words."""
    if limits.decision == "simple":
        return "simple acceptance: no guard band"
    return f"ISO 14253-1, guard band {limits.guard_factor:g} u"


def worst(verdicts: list[Verdict]) -> Verdict:
    """Say what many verdicts come to: one rejection rejects."""
    for verdict in ("reject", "neither"):
        if verdict in verdicts:
            return verdict
    return "accept"
