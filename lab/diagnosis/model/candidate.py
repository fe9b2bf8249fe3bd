"""Candidates for what the model lacks, and banks of them.

A candidate is a block C of a few columns: how the rows change with its parameters.
Whatever the model lacks moves the data by C nabla, so every candidate is judged by
the part of P values that its P C explains.
"""

from dataclasses import dataclass
from enum import Enum, auto
from typing import Any

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.effect_table import EFFECT_KINDS, Family


class BankName(Enum):
    """Source of a candidate; each bank has its own threshold."""

    LIBRARY = auto()  # every effect of the contract on every joint, but for steps
    STEPS = auto()  # slips of every joint and steps of the base, at every moment
    GENERIC = auto()  # splines of every joint against every covariate
    HARMONIC = auto()  # harmonics of every joint
    TRANSMISSION = auto()  # waves of every joint of any number of cycles a turn


@dataclass(frozen=True, slots=True, kw_only=True)
class Candidate:
    """A possibly missing effect.

    Attributes:
        kind: Of the arm file's effects; "empirical" in the generic bank.
        order: Of a harmonic or an error motion, or None.
        component: "radial", "axial" of a runout; the direction in which a spline
            moves the joint ("angle", "tilt", "shift") in the generic bank; or None.
        covariate: Of a spline: named like a column of the campaign; or None.
        artefact: Whose length it is, or None.
        at_s: Time of a step, in the campaign's time [s]; or None.
        parameters: Names of the columns: keys of the arm file, with .v, .w, .u for
            directions across or along the axis, .x, .y, .z for those of the arm's
            system; of a spline .1, .2 ...
        scales: Plausible amplitude of each column, in the unit of the key.
        log_prior: Preference in ranking only.
        keys: Fixed keys of the arm file's entry, such as order or component.
    """

    bank: BankName
    kind: str
    joint: str | None
    order: int | None = None
    component: str | None = None
    covariate: str | None = None
    artefact: str | None = None
    at_s: float | None = None
    parameters: tuple[str, ...] = ()
    scales: tuple[float, ...] = ()
    log_prior: float = 0.0
    keys: tuple[tuple[str, Any], ...] = ()

    @property
    def size(self) -> int:
        """The number of columns."""
        return len(self.parameters)

    @property
    def is_curve(self) -> bool:
        """Whether it is a curve without a physical name."""
        return EFFECT_KINDS[self.kind].family is Family.CURVE

    @property
    def cycles(self) -> float | None:
        """Periods a turn, if it is a wave of the reading."""
        return dict(self.keys).get("cycles", self.order)

    @property
    def name(self) -> str:
        """In words for people: `encoder_harmonic 5 J3`."""
        parts = (self.kind, self.component, self.order, self.joint, self.artefact)
        told = " ".join(str(part) for part in parts if part is not None)
        if self.covariate is not None:
            told += f" over {self.covariate}"
        return told

    @property
    def identity(self) -> tuple[str, str | None, int | None, str | None, str | None]:
        """Identity of an effect, independent of its size."""
        component = self.component if EFFECT_KINDS[self.kind].components else None
        return self.kind, self.joint, self.order, component, self.artefact


@dataclass(frozen=True, slots=True, eq=False)
class Bank:
    """Candidates with their columns.

    Attributes:
        columns: C of all candidates side by side, in units of their scales, before
            projection, (n_rows, n_columns).
    """

    candidates: tuple[Candidate, ...]
    columns: Floats

    @property
    def slices(self) -> tuple[slice, ...]:
        """Which columns belong to which candidate."""
        ends = np.cumsum([candidate.size for candidate in self.candidates])
        starts = ends - [candidate.size for candidate in self.candidates]
        return tuple(slice(int(a), int(b)) for a, b in zip(starts, ends, strict=True))
