"""The library: every effect of the arm file on every joint, as columns.

Left out are steps, whose moments are scanned (`steps`), and curves without a name
(`generic`). What the campaign cannot speak about, since it has no such column or the
column does not vary, is reported with the reason.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.arm_file.arm import Arm
from traverse.kinematics.effect_table import EFFECT_KINDS
from traverse.kinematics.effects import effect_class
from traverse.kinematics.effects.arm_effects import ArmEffects, effects_of
from traverse.kinematics.effects.base.bodies import bodies_from_arm
from traverse.kinematics.effects.base.context import context_from_arm
from traverse.kinematics.effects.base.correction import ContactCorrection, Correction
from traverse.kinematics.effects.mechanics.deformations import Compliance
from traverse.lab.diagnosis.model.candidate import (
    Bank,
    candidate_of_kind,
    effect_of_candidate,
)
from traverse.lab.diagnosis.model.covariates import covariate_values, varies
from traverse.lab.diagnosis.model.fit import effect_columns
from traverse.lab.diagnosis.model.observation_equations import ObservationEquations
from traverse.lab.first_moments import assumed_moments, first_moments, states_no_mass
from traverse.lab.outcomes.candidate import BankName, Candidate

# Higher orders of the encoders are found by the bank of harmonics.
HIGHEST_ORDER = 4


@dataclass(frozen=True, slots=True, eq=False)
class _Entry:
    """A candidate with the effect that makes its columns.

    Attributes:
        correction: Of unit size where sizes do not enter linearly, else of none.
        reason: Why the campaign says nothing about it; None where it does.
    """

    candidate: Candidate
    correction: Correction
    reason: str | None


def library_bank(rows: ObservationEquations, arm: Arm) -> Bank:
    """Compute the columns of all effects that the campaign can speak about.

    At the estimates of the fit, its effects applied; of the arm only masses, reference
    temperature and joint names are looked at. Columns are whitened, in units of
    plausible amplitudes, (n_rows, n_columns).
    """
    entries = [entry for entry in _entries(rows, arm) if entry.reason is None]
    moving = [e.correction for e in entries if e.candidate.artefact is None]
    state = rows.adjustment.state
    applied = _applied(rows, arm)
    by_values = effect_columns(rows, applied, moving)
    candidates, parts, first_column = [], [], 0
    for entry in entries:
        candidate, n_values = entry.candidate, len(entry.correction.values)
        if candidate.artefact is not None:
            part = rows.by_artefact_length(candidate.artefact)
        else:
            part = by_values[:, first_column : first_column + n_values]
            first_column += n_values
        if n_values != candidate.size:
            part = part @ entry.correction.free_directions(state.arm.geometry)
        if isinstance(entry.correction, Compliance) and states_no_mass(arm):
            candidate, beside = _with_moments(
                rows, arm, applied, candidate, entry.correction
            )
            part = np.hstack([part, beside])
        candidates.append(candidate)
        parts.append(part * np.array(candidate.scales))
    return Bank(tuple(candidates), np.concatenate(parts, axis=1))


def _applied(rows: ObservationEquations, arm: Arm) -> ArmEffects:
    """Return the effects of the fit; without masses also all first moments."""
    network, state = rows.adjustment.network, rows.adjustment.state
    model, span = network.parameters.effects, network.campaign.span
    applied = (
        effects_of(arm, (), span) if model is None else model.at(state.arm.amplitudes)
    )
    if not states_no_mass(arm):
        return applied
    known = {moment.joints.start for moment in applied.first_moments}
    assumed = effects_of(arm, first_moments(arm), span).first_moments
    more = [moment for moment in assumed if moment.joints.start not in known]
    return replace(applied, corrections=(*applied.corrections, *more))


def _with_moments(
    rows: ObservationEquations,
    arm: Arm,
    applied: ArmEffects,
    candidate: Candidate,
    correction: Compliance,
) -> tuple[Candidate, Floats]:
    """Let other first moments than those of the fit be what a candidate yields to.

    Without masses they are not known. Each may differ by its assumed standard
    deviation; columns are those of the products with the compliance, (n_rows, n_more).
    """
    stds_kg_m = assumed_moments(arm).stds_kg_m
    carried = [
        moment
        for moment in applied.first_moments
        if moment.joints.start >= correction.joints.start
    ]
    unit = replace(correction, values=(1.0,))
    names = [f"{arm.joints[m.joints.start].name}.{c}" for m in carried for c in "xyz"]
    (scale,) = candidate.scales
    scales = [scale * stds_kg_m[m.joints.start] for m in carried for _ in range(3)]
    widened = replace(
        candidate,
        parameters=(*candidate.parameters, *names),
        scales=(scale, *scales),
    )
    return widened, effect_columns(rows, applied, carried, [unit])


def absent_candidates(
    rows: ObservationEquations, arm: Arm
) -> tuple[tuple[Candidate, str], ...]:
    """List the effects that campaign or arm file say nothing about, and the reasons."""
    return tuple(
        (entry.candidate, entry.reason)
        for entry in _entries(rows, arm)
        if entry.reason is not None
    )


def _entries(rows: ObservationEquations, arm: Arm) -> list[_Entry]:
    campaign = rows.adjustment.network.campaign
    setting = context_from_arm(arm, campaign.span)
    are_known = bodies_from_arm(arm).are_known | states_no_mass(arm)
    entries = []
    for plain in _candidates(rows):
        # Lobes of unit size: their columns are the derivatives there.
        template = np.zeros(plain.size)
        template[0] = EFFECT_KINDS[plain.kind].phase is not None
        effect = effect_of_candidate(plain, template, rows)
        correction = effect_class(plain.kind).from_file(effect, setting)
        # Its columns are all of one unit.
        scales = campaign.plausible_values(correction)[:1] * plain.size
        candidate = replace(plain, scales=scales)
        if correction.uses_gravity and not np.any(are_known[correction.joints.start :]):
            beyond = plain.joint or setting.joint_names[0]
            reason: str | None = f"no mass is known from {beyond} outwards"
        else:
            reason = _silence(rows, correction)
        entries.append(_Entry(candidate, correction, reason))
    return entries


def _candidates(rows: ObservationEquations) -> Iterator[Candidate]:
    """Go through the whole library, without scales."""
    listed = {k: row for k, row in EFFECT_KINDS.items() if row.bank == "library"}
    # Sorted, orders up to the highest alternate between kinds.
    waves = sorted(
        (number, order, index, kind, component)
        for index, (kind, row) in enumerate(listed.items())
        if row.has_order
        for number, component in enumerate(tuple(row.components) or (None,))
        for order in range(row.least_order(component), HIGHEST_ORDER + 1)
    )
    for joint in rows.adjustment.network.campaign.joint_names:
        for kind, row in listed.items():
            if row.joint != "absent" and not row.has_order:
                yield candidate_of_kind(BankName.LIBRARY, kind, joint, {})
        for _, order, _, kind, component in waves:
            fixed = {"component": component, "order": order}
            yield candidate_of_kind(BankName.LIBRARY, kind, joint, fixed)
    artefacts = dict.fromkeys(of for _, of, _ in rows.certificates)
    for kind, row in sorted(listed.items(), key=lambda item: item[1].joint == "absent"):
        if row.joint != "required":
            named = artefacts if "artefact" in row.keys else (None,)
            for artefact in named:
                fixed = {"artefact": artefact}
                yield candidate_of_kind(BankName.LIBRARY, kind, None, fixed)


def _silence(rows: ObservationEquations, correction: Correction) -> str | None:
    """Return why the campaign says nothing about an effect, or None where it does."""
    block = rows.block
    lacks = [lack for need in correction.needs if (lack := block.lack(need))]
    if lacks:
        return lacks[0]
    constant = [
        need
        for need in correction.needs
        if not varies(rows, covariate_values(rows, need))
    ]
    if constant and len(constant) == len(correction.needs):
        return f"the {constant[0].covariate.value} does not vary"
    if isinstance(correction, ContactCorrection):
        directions, used = block.directions, rows.used_poses
        if directions is None or not np.isfinite(directions[used]).all(axis=1).any():
            return "no direction of a touched surface is known"
    return None
