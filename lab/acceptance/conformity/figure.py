"""Figures of acceptance as values: with definition, uncertainty, limit and decision."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

from traverse.lab.acceptance.conformity.decision import Decision, Verdict, worst
from traverse.lab.acceptance.conformity.uncertainty_budget import Budget

# What a definition was taken from.
Source = Literal["published", "general knowledge"]
CONFIRM = "confirm against your copy of the standard"


@dataclass(frozen=True, slots=True)
class Figure:
    """One figure of a standard.

    Attributes:
        key: In files, for example `p_size`.
        name: As the standard calls it.
        definition: How it was computed, in words.
        source: Where the definition comes from; general knowledge is to be confirmed.
        value_mm: Signed where the definition is.
        budget: Of its uncertainty.
        decision: None where the limits give no limit.
        parts: Further figures that it is made of, in mm by name.
        remarks: What is not as the standard wants it.
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

    @property
    def confirm(self) -> str:
        """What to say beside the definition, empty where there is nothing."""
        return "" if self.source == "published" else CONFIRM


@dataclass(frozen=True, slots=True)
class Missing:
    """A figure that cannot be computed.

    Attributes:
        name: Of the figure.
        what: What is missing or too much, one line each.
    """

    name: str
    what: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class LengthError:
    """One measured length of a set, for tables and plots.

    Attributes:
        artefact: Its id.
        repeat: From 1.
        length_mm: Certified.
        error_mm: Measured less certified, at the temperature of the measurement.
        limit_mm: None without a limit.
        standard_mm: Standard uncertainty of the error.
        role: "set", or "repeat" of the ten that were measured again.
    """

    artefact: str
    repeat: int
    length_mm: float
    error_mm: float
    limit_mm: float | None
    standard_mm: float
    role: Literal["set", "repeat"] = "set"


@dataclass(frozen=True, slots=True, eq=False)
class Scatter:
    """Distances of touched points from a fitted shape, for plots.

    Attributes:
        name: What was touched.
        deviations_mm: In the order of the touches.
    """

    name: str
    deviations_mm: tuple[float, ...]


Part = Figure | Missing | LengthError | Scatter


@dataclass(frozen=True, slots=True, eq=False)
class Verification:
    """All that a standard asks for.

    Attributes:
        standard: Its name in commands.
        title: Its full name.
        figures: That could be computed.
        missing: That could not.
        lengths: Every measured length.
        scatters: Of the probing tests.
        remarks: About the whole.
    """

    standard: str
    title: str
    figures: tuple[Figure, ...]
    missing: tuple[Missing, ...]
    lengths: tuple[LengthError, ...]
    scatters: tuple[Scatter, ...]
    remarks: tuple[str, ...] = ()

    @property
    def verdict(self) -> Verdict | None:
        """What the decisions come to; None without any."""
        verdicts = [f.decision.verdict for f in self.figures if f.decision]
        return worst(verdicts) if verdicts else None

    @property
    def is_good(self) -> bool:
        """Nothing is missing, and nothing but accepted."""
        return not self.missing and self.verdict in (None, "accept")


def verification(
    standard: str, title: str, parts: Iterable[Part], remarks: Iterable[str]
) -> Verification:
    """Sort what the tests of a standard gave."""
    found = list(parts)
    return Verification(
        standard,
        title,
        tuple(part for part in found if isinstance(part, Figure)),
        tuple(part for part in found if isinstance(part, Missing)),
        tuple(part for part in found if isinstance(part, LengthError)),
        tuple(part for part in found if isinstance(part, Scatter)),
        tuple(remarks),
    )
