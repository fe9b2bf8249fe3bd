"""Figures of acceptance as values: with definition, uncertainty, limit and decision.

Conformity, with u the standard uncertainty of the test value, g the guard factor, MPE
the limit:

    rule         accept               reject               neither
    iso14253-1   |e| <= MPE - g u     |e| > MPE + g u      between
    simple       |e| <= MPE           |e| > MPE            never

Between the guard bands neither conformity nor its opposite is proved: who has to prove
loses (the supplier cannot prove conformity, nor the customer the opposite). Where u is
not stated nothing is decided: "undecided".

The uncertainty of a test value is what the standard adds, not what the arm does: the
arm's own errors, its repeatability included, are what is tested. What remains are the
standard's certificate, its temperature, its expansion, its form, and how firmly it
stood (in the manner of ISO/TS 23165 [K]).
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, PlainValidator

from traverse.lab.artefacts.materials import Expansion
from traverse.strict_toml.reader import StrictModel

# ISO 14253-1:2017: 95 % for one limit needs 1.65 standard uncertainties.
GUARD_FACTOR = 1.65
COVERAGE_FACTOR = 2.0


class LengthLimit(StrictModel):
    """A limit that grows with the length: constant + per_m L, most at the most."""

    constant_mm: float = Field(ge=0.0)
    per_m_mm: float = Field(default=0.0, ge=0.0)
    most_mm: float | None = Field(default=None, gt=0.0)

    def at(self, length_mm: float) -> float:
        """Return the limit for a length."""
        limit_mm = self.constant_mm + 1e-3 * length_mm * self.per_m_mm
        return limit_mm if self.most_mm is None else min(limit_mm, self.most_mm)


def _length_limit(value: object) -> object:
    if isinstance(value, int | float) and not isinstance(value, bool):
        value = {"constant_mm": value}
    if isinstance(value, Mapping):
        return LengthLimit.model_validate(dict(value))
    if isinstance(value, LengthLimit):
        return value
    raise ValueError(
        f"{value!r} is neither a number nor a table of constant_mm, per_m_mm, most_mm"
    )


Length = Annotated[Any, PlainValidator(_length_limit)]
Limit = Annotated[float | None, Field(gt=0.0)]


class Mpe(StrictModel):
    """Maximum permissible errors; a figure without one gets no decision."""

    p_size_mm: Limit = None
    p_form_mm: Limit = None
    l_dia_mm: Limit = None
    e_uni_mm: Length = None
    e_bi_mm: Length = None
    effective_diameter_mm: Limit = None
    spat_max_mm: Limit = None
    spat_2s_mm: Limit = None
    volumetric_max_mm: Limit = None
    volumetric_2rms_mm: Limit = None
    interim_length_mm: Length = None

    def of(self, key: str) -> LengthLimit | None:
        """Return the limit of a figure by its key."""
        value = getattr(self, f"{key}_mm")
        if value is None or isinstance(value, LengthLimit):
            return value
        return LengthLimit(constant_mm=value)


class Standards(StrictModel):
    """Data of the material standards beyond the campaign's certificates.

    Attributes:
        temperature_std_c: Standard uncertainty of a standard's temperature.
        form_mm: Form error of the test sphere by its certificate.
        form_std_mm: Standard uncertainty of that.
        fixture_std_mm: How far a standard moves in its fixture while it is measured.
    """

    temperature_std_c: float = Field(default=0.0, ge=0.0)
    form_mm: float = Field(default=0.0, ge=0.0)
    form_std_mm: float = Field(default=0.0, ge=0.0)
    fixture_std_mm: float = Field(default=0.0, ge=0.0)


class Limits(StrictModel):
    """A file of limits as written.

    Attributes:
        decision: `iso14253-1` with guard bands, or `simple` acceptance without.
        guard_factor: Guard band in standard uncertainties.
        coverage_factor: Of the expanded uncertainties that are reported.
        measuring_range_mm: Diameter of the volume; else twice the reach of the arm.
        l_dia_radius: Whether the spheres of L_DIA are fitted with their radius free.
    """

    schema_: Literal["traverse/acceptance-limits/1"] = Field(alias="schema")
    decision: Literal["iso14253-1", "simple"] = "iso14253-1"
    guard_factor: float = Field(default=GUARD_FACTOR, gt=0.0)
    coverage_factor: float = Field(default=COVERAGE_FACTOR, gt=0.0)
    measuring_range_mm: float | None = Field(default=None, gt=0.0)
    l_dia_radius: Literal["free", "calibrated"] = "free"
    mpe: Mpe = Mpe()
    standards: Standards = Standards()


NO_LIMITS = Limits(schema="traverse/acceptance-limits/1")


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
    """Return the rule in words."""
    if limits.decision == "simple":
        return "simple acceptance: no guard band"
    return f"ISO 14253-1, guard band {limits.guard_factor:g} u"


def worst(verdicts: list[Verdict]) -> Verdict:
    """Combine verdicts: one rejection rejects."""
    for verdict in ("reject", "undecided", "neither"):
        if verdict in verdicts:
            return verdict
    return "accept"


@dataclass(frozen=True, slots=True)
class Contribution:
    """One line of a budget.

    Attributes:
        formula: With the numbers in it; or where to state it.
        standard_mm: Standard uncertainty of the test value from it; None where it is
            required and not stated.
    """

    name: str
    formula: str
    standard_mm: float | None


def required(name: str, formula: str, standard_mm: float, where: str) -> Contribution:
    """Make a line without which no uncertainty is stated: 0 mm is not stated.

    The line then names where to state it: the keys and their file.
    """
    if standard_mm > 0.0:
        return Contribution(name, formula, standard_mm)
    return Contribution(name, f"give {where}", None)


IN_LIMITS = "in [standards] of the limits"


@dataclass(frozen=True, slots=True)
class Budget:
    """The standard uncertainty of a test value, line by line."""

    lines: tuple[Contribution, ...]

    @property
    def standard_mm(self) -> float | None:
        """Root of the sum of squares; None where a required line is not stated."""
        sizes_mm = [line.standard_mm for line in self.lines]
        if None in sizes_mm:
            return None
        return float(np.sqrt(sum((size_mm or 0.0) ** 2 for size_mm in sizes_mm)))

    def times(self, factor: float) -> "Budget":
        """Return the budget of a multiple of the test value."""
        return Budget(
            tuple(
                line
                if line.standard_mm is None
                else replace(
                    line,
                    formula=f"{factor:g} x {line.formula}",
                    standard_mm=factor * line.standard_mm,
                )
                for line in self.lines
            )
        )


def length_budget(
    length_mm: float,
    calibration_mm: float,
    standards: Standards,
    expansion: Expansion,
    warmer_c: float,
) -> Budget:
    """Draw up the budget of a certified length, which may be a diameter.

    The calibration is its standard uncertainty, the temperature is less that of the
    certificate.
    """
    per_c, std_per_c = expansion.per_c, expansion.std_per_c
    return Budget(
        (
            required(
                "calibration",
                "of the certificate",
                calibration_mm,
                "distance_std_mm, radius_std_mm or points_std_mm in campaign.toml",
            ),
            Contribution(
                "expansion coefficient",
                "give material, or expansion_per_c and expansion_std_per_c, in "
                "campaign.toml",
                None,
            )
            if per_c is None or std_per_c is None
            else Contribution(
                "expansion coefficient",
                f"{length_mm:g} mm x {std_per_c:g} /C x {abs(warmer_c):.2f} C",
                length_mm * std_per_c * abs(warmer_c),
            ),
            Contribution("temperature", "the standard does not expand", 0.0)
            if not per_c
            else required(
                "temperature",
                f"{length_mm:g} mm x {per_c:g} /C x {standards.temperature_std_c:g} C",
                length_mm * abs(per_c) * standards.temperature_std_c,
                f"temperature_std_c {IN_LIMITS}",
            ),
            Contribution("fixture", "as stated", standards.fixture_std_mm),
        )
    )


def form_budget(standards: Standards) -> Budget:
    """Draw up the budget of what the form of a test sphere disturbs."""
    return Budget(
        (
            required(
                "form of the sphere",
                f"{standards.form_mm:g} mm / 2",
                standards.form_mm / 2.0,
                f"form_mm {IN_LIMITS}",
            ),
            Contribution("its uncertainty", "as stated", standards.form_std_mm),
            Contribution("fixture", "as stated", standards.fixture_std_mm),
        )
    )


def fixture_budget(standards: Standards) -> Budget:
    """Draw up the budget of a test that needs no calibrated standard."""
    fixture_mm = standards.fixture_std_mm
    where = f"fixture_std_mm {IN_LIMITS}"
    return Budget((required("fixture", "as stated", fixture_mm, where),))


# What a definition was taken from.
Source = Literal["published", "general knowledge"]
CONFIRM = "confirm against your copy of the standard"


@dataclass(frozen=True, slots=True)
class Figure:
    """One figure of a standard.

    Attributes:
        key: In files, for example `p_size`.
        definition: How it was computed, in words.
        source: Source of the definition; general knowledge is to be confirmed.
        value_mm: Signed where the definition is.
        decision: None where the limits give no limit.
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
    parts: tuple[tuple[str, float], ...] = ()
    remarks: tuple[str, ...] = ()
    tool: str | None = None

    @property
    def confirm(self) -> str:
        """Remarks beside the definition, empty without any."""
        return "" if self.source == "published" else CONFIRM


def judged_figure(
    limits: Limits,
    key: str,
    name: str,
    definition: str,
    value_mm: float,
    *,
    budget: Budget,
    length_mm: float = 0.0,
    source: Source = "general knowledge",
    parts: Iterable[tuple[str, float]] = (),
    remarks: Iterable[str] = (),
) -> Figure:
    """Make a figure, decided on where it has a limit, for a length where that grows."""
    limit = limits.mpe.of(key)
    decision = None
    if limit is not None:
        limit_mm = limit.at(length_mm)
        decision = decision_of(value_mm, limit_mm, budget.standard_mm, limits)
    return Figure(
        key,
        name,
        definition,
        source,
        value_mm,
        budget,
        decision,
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
        standard_mm: Standard uncertainty of the error; None where not stated.
        role: "set", or "repeat" of the ten that were measured again.
        tool: As of a figure.
    """

    artefact: str
    repeat: int
    length_mm: float
    error_mm: float
    limit_mm: float | None
    standard_mm: float | None
    role: Literal["set", "repeat"] = "set"
    tool: str | None = None


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
    """

    standard: str
    title: str
    figures: tuple[Figure, ...]
    missing: tuple[Missing, ...]
    lengths: tuple[LengthError, ...]
    scatters: tuple[Scatter, ...]
    remarks: tuple[str, ...] = ()
    predicted: PredictedLengths | None = None
