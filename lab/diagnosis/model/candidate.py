"""Candidates for what the model lacks, and banks of them.

A candidate is a block C of a few columns: how the rows change with its parameters.
Whatever the model lacks moves the data by C nabla, so every candidate is judged by
the part of P values that its P C explains. What is found becomes an entry of the arm
file.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.arm_file.arm import Effect, effect_from_table
from traverse.kinematics.effect_table import EFFECT_KINDS, EffectKind, Family
from traverse.kinematics.model.geometry import across
from traverse.lab.diagnosis.model.observation_equations import ObservationEquations
from traverse.lab.outcomes.candidate import BankName, Candidate


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


def has_own_curve(candidate: Candidate, joints_with_own_curve: Collection[str]) -> bool:
    """Say whether a candidate is a function of a reading that has a curve already."""
    if candidate.joint not in joints_with_own_curve:
        return False
    own_curve = candidate.covariate == f"{candidate.joint}_rad"
    return own_curve or EFFECT_KINDS[candidate.kind].family is Family.OWN_ANGLE


def parameter_names(kind: str, component: str | None = None) -> tuple[str, ...]:
    """Name the columns of a kind of effect.

    Numbers have one column. Vectors have one for each direction in which they are
    free: v and w across the joint's axis, u along it, x, y, z in the arm's system.
    Lobes have two, since their phase is not linear: of cos 3 psi and sin 3 psi.
    """
    row = EFFECT_KINDS[kind]
    if row.phase is not None:
        return tuple(f"{_amplitude(row)}.{part}" for part in ("cos", "sin"))
    about_axis = "u" if component == "axial" else "vw"
    directions = about_axis if row.is_about_axis else "xyz"
    parts = {key: [f"{key}.{of}" for of in directions] for key in row.vectors}
    return tuple(name for key in row.sizes for name in parts.get(key, [key]))


def candidate_of_kind(
    bank: BankName,
    kind: str,
    joint: str | None,
    fixed: Mapping[str, Any],
    scale: float = 1.0,
) -> Candidate:
    """Describe an effect that might be missing.

    Of the fixed keys those that are None do not belong to the kind; all columns have
    one scale, a plausible amplitude.
    """
    parameters = parameter_names(kind, fixed.get("component"))
    stated = {key: value for key, value in fixed.items() if value is not None}
    return Candidate(
        bank=bank,
        kind=kind,
        joint=joint,
        order=stated.get("order"),
        cycles=stated.get("cycles"),
        component=stated.get("component"),
        artefact=stated.get("artefact"),
        at_s=stated.get("at_s"),
        parameters=parameters,
        scales=(scale,) * len(parameters),
        log_prior=EFFECT_KINDS[kind].preference(joint, stated.get("order")),
        keys=tuple(stated.items()),
    )


def effect_of_candidate(
    candidate: Candidate, values: Floats, rows: ObservationEquations
) -> Effect:
    """Write a candidate down as an entry of the arm file.

    The values are amplitudes of its columns in the unit of the keys, (n_columns,). The
    rows are of the fit that these belong to: directions across an axis are those of its
    geometry, times count from the start of its campaign.

    Raises:
        ValueError: A curve that tilts or shifts a joint has no entry in an arm file.
    """
    if candidate.is_curve and candidate.component != "angle":
        raise ValueError(
            f"{candidate.name}: the arm file has no curve that moves a joint by its "
            f"{candidate.component}; expected a candidate with the component 'angle'"
        )
    table: dict[str, Any] = {"kind": candidate.kind, **dict(candidate.keys)}
    campaign = rows.adjustment.network.campaign
    if candidate.joint is not None:
        table["joint"] = candidate.joint
    row = EFFECT_KINDS[candidate.kind]
    if row.effect_class == "A":
        table["epoch_utc"] = campaign.start
    if row.phase is not None:
        cosine, sine = values.tolist()
        table[_amplitude(row)] = float(np.hypot(cosine, sine))
        table[row.phase] = float(np.arctan2(sine, cosine))
        return effect_from_table(table)
    directions: dict[str, Floats] = {}
    if row.is_about_axis:
        joint = campaign.joint_names.index(str(candidate.joint))
        axis = rows.adjustment.state.arm.geometry.axes[joint]
        directions = dict(zip("vwu", (*across(axis), axis), strict=True))
    vectors: dict[str, Floats] = {}
    for name, value in zip(candidate.parameters, values.tolist(), strict=True):
        key, dot, part = name.partition(".")
        if key not in row.keys:
            continue  # of another entry: a first moment that it yields to
        if not dot:
            table[key] = value
        elif part in directions:
            vectors[key] = vectors.get(key, np.zeros(3)) + value * directions[part]
        else:
            vectors[key] = np.append(vectors.get(key, np.empty(0)), value)
    for key, vector in vectors.items():
        table[key] = tuple(vector.tolist())
    return effect_from_table(table)


def _amplitude(row: EffectKind) -> str:
    """Name the key that belongs to a phase."""
    return next(key for key in row.keys if key != row.phase)
