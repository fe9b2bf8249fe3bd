"""A candidate for what the model lacks, as reports and JSON name it."""

from dataclasses import dataclass, field
from enum import StrEnum, auto
from typing import Any

from traverse.kinematics.effect_table import EFFECT_KINDS, Family
from traverse.lab.report.quantities import HIDDEN, OMITTED


class BankName(StrEnum):
    """Source of a candidate; each bank has its own threshold."""

    LIBRARY = auto()  # every effect of the contract on every joint, but for steps
    STEPS = auto()  # slips of every joint and steps of the base, at every moment
    GENERIC = auto()  # splines of every joint against every covariate
    HARMONIC = auto()  # harmonics of every joint
    TRANSMISSION = auto()  # waves of every joint of any number of cycles a turn


@dataclass(frozen=True, slots=True, kw_only=True)
class Candidate:
    """A possibly missing effect, by its keys in the arm file or by its covariate.

    Attributes:
        kind: Of the arm file's effects; "empirical" in the generic bank.
        order: Of a harmonic or an error motion, or None.
        cycles: Periods a turn of a wave of any number of them, or None.
        component: "radial", "axial" of a runout; the direction in which a spline
            moves the joint ("angle", "tilt", "shift") in the generic bank; or None.
        covariate: Of a spline: named like a column of the campaign; or None.
        artefact: Whose length it is, or None.
        at_s: Time of a step, in the campaign's time [s]; or None.
        parameters: Names of the columns: keys of the arm file, with .v, .w, .u for
            directions across or along the axis, .x, .y, .z for those of the arm's
            system; of a spline .1, .2 ...; then of the first moments of an arm without
            masses, relative to what the effect's own key yields to, J2.x ...
        scales: Plausible amplitude of each column, in the unit of the key.
        log_prior: Preference in ranking only.
        keys: Fixed keys of the arm file's entry, such as order or component.
    """

    kind: str
    joint: str | None
    order: int | None = None
    cycles: float | None = None
    component: str | None = None
    covariate: str | None = None
    artefact: str | None = field(default=None, metadata=OMITTED)
    at_s: float | None = field(default=None, metadata=OMITTED)
    bank: BankName = field(metadata=HIDDEN)
    parameters: tuple[str, ...] = field(default=(), metadata=HIDDEN)
    scales: tuple[float, ...] = field(default=(), metadata=HIDDEN)
    log_prior: float = field(default=0.0, metadata=HIDDEN)
    keys: tuple[tuple[str, Any], ...] = field(default=(), metadata=HIDDEN)

    @property
    def size(self) -> int:
        return len(self.parameters)

    @property
    def is_curve(self) -> bool:
        """Whether it is a curve without a physical name."""
        return EFFECT_KINDS[self.kind].family is Family.CURVE

    @property
    def is_length(self) -> bool:
        """Whether it is a wrong length of an artefact."""
        return EFFECT_KINDS[self.kind].family is Family.LENGTH

    @property
    def is_of_several(self) -> bool:
        """Whether several artefacts share it; their ids are joined."""
        return ", " in (self.artefact or "")

    @property
    def periods(self) -> float | None:
        """Periods a turn, if it is a wave of the reading."""
        return self.order if self.cycles is None else self.cycles

    @property
    def name(self) -> str:
        """In words for people: `encoder_harmonic 5 J3`."""
        parts = (self.kind, self.component, self.order, self.joint, self.artefact)
        words = " ".join(str(part) for part in parts if part is not None)
        return words if self.covariate is None else f"{words} over {self.covariate}"

    @property
    def identity(self) -> tuple[str, str | None, int | None, str | None, str | None]:
        component = self.component if EFFECT_KINDS[self.kind].components else None
        return self.kind, self.joint, self.order, component, self.artefact
