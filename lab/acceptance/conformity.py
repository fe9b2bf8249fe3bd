"""Figures of acceptance as values: with definition, uncertainty, limit and decision.

Conformity, with u the standard uncertainty of the test value, g the guard factor, MPE
the limit:

    rule         accept               reject               neither
    iso14253-1   |e| <= MPE - g u     |e| > MPE + g u      between
    simple       |e| <= MPE           |e| > MPE            never

Between the guard bands neither conformity nor its opposite is proved: who has to prove
loses (the supplier cannot prove conformity, nor the customer the opposite). Where u is
not stated nothing is decided: "undecided".
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import repeat
from typing import Literal

import numpy as np

from traverse.lab.acceptance.budget import Budget
from traverse.lab.acceptance.limits import Limits
from traverse.lab.acceptance.monte_carlo import Model

Verdict = Literal["accept", "reject", "neither", "undecided"]


@dataclass(frozen=True, slots=True)
class Decision:
    """Verdict on a figure, and its decision rule.

    Attributes:
        verdict: accept, reject, neither, or undecided for want of an uncertainty.
        guard_mm: Width of the guard band; 0 with simple acceptance, None where the
            uncertainty is not stated.
    """

    verdict: Verdict
    limit_mm: float
    guard_mm: float | None
    rule: str


def decision_of(
    error_mm: float, limit_mm: float, standard_mm: float | None, limits: Limits
) -> Decision:
    """Decide on one error, signed or not, by the rule of the limits.

    The standard uncertainty of the test value is None where it is not stated.
    """
    guard_mm = guard_of(standard_mm, limits)
    size_mm = abs(error_mm)
    verdict: Verdict = "neither"
    if guard_mm is None:
        verdict = "undecided"
    elif size_mm <= limit_mm - guard_mm:
        verdict = "accept"
    elif size_mm > limit_mm + guard_mm:
        verdict = "reject"
    return Decision(verdict, limit_mm, guard_mm, rule_text(limits))


def guard_of(standard_mm: float | None, limits: Limits) -> float | None:
    """Return how wide the guard band is; None where its uncertainty is not stated."""
    if standard_mm is None:
        return None
    return 0.0 if limits.decision == "simple" else limits.guard_factor * standard_mm


def rule_text(limits: Limits) -> str:
    if limits.decision == "simple":
        return "simple acceptance: no guard band"
    return f"ISO 14253-1, guard band {limits.guard_factor:g} u"


def worst(verdicts: list[Verdict]) -> Verdict:
    """Combine verdicts: one rejection rejects."""
    for verdict in ("reject", "undecided", "neither"):
        if verdict in verdicts:
            return verdict
    return "accept"


# What a definition was taken from.
Source = Literal["published", "general knowledge"]
CONFIRM = "confirm against your copy of the standard"


@dataclass(frozen=True, slots=True, eq=False)
class Figure:
    """One figure of a standard.

    Attributes:
        key: In files, for example `p_size`.
        definition: How it was computed, in words.
        source: Source of the definition; general knowledge is to be confirmed.
        value_mm: Signed where the definition is.
        decision: None where the limits give no limit.
        model: Of which test values it is made.
        parts: Further figures that it is made of, in mm by name.
        remarks: Deviations from the standard.
        tool: With which it was measured, where the campaign names tools.
    """

    key: str
    name: str
    definition: str
    source: Source
    value_mm: float
    budget: Budget
    decision: Decision | None
    model: Model
    parts: tuple[tuple[str, float], ...] = ()
    remarks: tuple[str, ...] = ()
    tool: str | None = None

    @property
    def confirm(self) -> str:
        return "" if self.source == "published" else CONFIRM


def judged_figure(
    limits: Limits,
    key: str,
    name: str,
    definition: str,
    value_mm: float,
    *,
    budget: Budget,
    model: Model | None = None,
    lengths_mm: Sequence[float] = (),
    source: Source = "general knowledge",
    parts: Iterable[tuple[str, float]] = (),
    remarks: Iterable[str] = (),
) -> Figure:
    """Make a figure, decided on where it has a limit, for lengths where that grows.

    All test values of which it is the largest must keep to the limit, each with its own
    uncertainty.
    """
    model = model or Model(np.array([value_mm]), (budget,))
    limit = limits.mpe.of(key)
    decision = None
    if limit is not None:
        tests = list(zip(model.values_mm.tolist(), model.budgets, strict=True))
        if model.reduction == "twice rms":
            tests = [(value_mm, budget)]
        decisions = [
            (test_mm, decision_of(test_mm, limit.at(mm), each.standard_mm, limits))
            for (test_mm, each), mm in zip(
                tests, lengths_mm or repeat(0.0), strict=False
            )
        ]
        nearest = max(decisions, key=lambda of: abs(of[0]) / (of[1].limit_mm or 1.0))
        verdict = worst([each.verdict for _, each in decisions])
        decision = replace(nearest[1], verdict=verdict)
    return Figure(
        key,
        name,
        definition,
        source,
        value_mm,
        budget,
        decision,
        model,
        tuple(parts),
        tuple(remarks),
    )


@dataclass(frozen=True, slots=True)
class Missing:
    """A figure that cannot be computed: what is missing or too much, a line each."""

    name: str
    what: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class LengthError:
    """One measured length of a set, for tables and plots.

    Attributes:
        repeat: From 1.
        length_mm: Certified.
        error_mm: Measured less certified, at the temperature of the measurement.
        limit_mm: None without a limit.
        budget: Of the error.
        role: "set", or "repeat" of the ten that were measured again.
        tool: As of a figure.
    """

    artefact: str
    repeat: int
    length_mm: float
    error_mm: float
    limit_mm: float | None
    budget: Budget
    role: Literal["set", "repeat"] = "set"
    tool: str | None = None

    @property
    def standard_mm(self) -> float | None:
        """Standard uncertainty of the error; None where not stated."""
        return self.budget.standard_mm


@dataclass(frozen=True, slots=True, eq=False)
class Scatter:
    """Distances of touches, in their order, from a fitted shape, for plots."""

    name: str
    deviations_mm: tuple[float, ...]


Part = Figure | Missing | LengthError | Scatter


def with_tool(part: Part, tool: str) -> Part:
    """Say with which tool something was measured."""
    if isinstance(part, LengthError):
        return replace(part, tool=tool)
    named = replace(part, name=f"{part.name} with {tool}")
    return replace(named, tool=tool) if isinstance(named, Figure) else named


PREDICTED_FACTOR = 2.0


@dataclass(frozen=True, slots=True)
class PredictedLengths:
    """What the arm's files say of n measured lengths.

    Attributes:
        stds_mm: Standard uncertainty of each, in the order of the errors.
        n_inside: So many errors lie within U, k = 2, of arm and standard together.
        sigma0: Errors as found over errors as predicted.
        p_value: Of errors so much larger by chance.
        explains: Whether the errors are as large as the files say, or smaller (5 %).
    """

    stds_mm: tuple[float, ...]
    n_inside: int
    sigma0: float
    p_value: float
    explains: bool


@dataclass(frozen=True, slots=True, eq=False)
class Verification:
    """Everything that a standard requires.

    Attributes:
        predicted: What the arm's files say of the lengths; None where they say nothing.
        contradictions: Of touches to arm file or artefacts, by more than any arm is
            off, a clause each.
    """

    standard: str
    title: str
    figures: tuple[Figure, ...]
    missing: tuple[Missing, ...]
    lengths: tuple[LengthError, ...]
    scatters: tuple[Scatter, ...]
    remarks: tuple[str, ...] = ()
    predicted: PredictedLengths | None = None
    contradictions: tuple[str, ...] = ()
