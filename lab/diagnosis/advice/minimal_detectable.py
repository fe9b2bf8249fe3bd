"""Minimal detectable size of every effect, and its influence on the probe.

An effect of the size nabla gives the F test of its block the non-centrality
lambda = |P C nabla|^2. With lambda_0 that is found with a power of 95 % at the level
at which a bank is judged, and the singular values s of the projected block,

    minimal detectable size = sqrt(lambda_0) / s

for the direction in which the block is weakest and for the strongest (Baarda's
internal reliability). What such an effect, not found, does to the calibrated arm is
its move of the probe, less what the estimated arm takes of it (external reliability).

What a campaign would show, before anything is measured.

The poses are taken as they are and the arm as it is given; no misclosure is looked
at. Only the artefacts' places are found from the readings.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import compress

import numpy as np
from scipy import special

from traverse.arrays import Floats
from traverse.kinematics.arm_file.arm import Arm
from traverse.kinematics.effect_table import EFFECT_KINDS, Family, key_unit
from traverse.kinematics.helmert.transformation import N_RIGID, motions
from traverse.kinematics.model.derivatives import probe_derivatives
from traverse.kinematics.model.forward import probe_centre
from traverse.lab.adjustment import Options, Problem, adjust
from traverse.lab.campaign.campaign import Campaign
from traverse.lab.diagnosis.candidates.library import absent_candidates, library_bank
from traverse.lab.diagnosis.candidates.scoring import (
    LEAST_SINGULAR_VALUE,
    ProjectedCandidate,
    project,
)
from traverse.lab.diagnosis.model.candidate import Bank
from traverse.lab.diagnosis.model.observation_equations import (
    LEAST_EFFECT,
    ObservationEquations,
    equations_of,
)
from traverse.lab.outcomes.candidate import Candidate
from traverse.lab.outcomes.diagnosis import Detectable, Size

# An axis within that of the direction of gravity is vertical.
_VERTICAL = 0.02
# A probe nearer to an axis than that lies on it, whatever the posture.
_ON_AXIS_MM = 0.5
_STANDARD_GRAVITY = (0.0, 0.0, -9.80665)


def reason(rows: ObservationEquations, candidate: Candidate, moved: float) -> str:
    """Return why an effect is undetectable.

    A plausible one changes the rows by that many standard deviations of the noise,
    unknowns not adjusted.
    """
    joint = candidate.joint
    row = EFFECT_KINDS[candidate.kind]
    equals = f"equals {row.absorbed_by.format(joint=joint)}"
    if row.family is Family.LENGTH:
        return f"nothing else tells how long a millimetre is: it {equals}"
    if joint is not None:
        is_twisted = row.family is Family.GRAVITY and row.acts_on == "angle"
        if is_twisted and is_vertical(rows, joint):
            return f"{joint} is vertical: gravity does not twist it"
        if row.acts_on == "angle" and probe_is_on_axis(rows, joint):
            return f"the probe lies on the axis of {joint}: its angle moves nothing"
    if moved > LEAST_SINGULAR_VALUE:
        return equals
    return "it moves the probe by far less than the noise in these poses"


def is_vertical(rows: ObservationEquations, joint: str) -> bool:
    """Return whether a joint's axis stays along gravity."""
    campaign = rows.adjustment.network.campaign
    # The arm's own gravity is not part of a fit; without an override it is usual.
    gravity = np.array(campaign.gravity_m_s2 or _STANDARD_GRAVITY)
    joint_index = campaign.joint_names.index(joint)
    axis = rows.adjustment.state.arm.geometry.axes[joint_index]
    across = np.linalg.norm(np.cross(axis, gravity)) / np.linalg.norm(gravity)
    return joint_index == 0 and bool(across < _VERTICAL)


def probe_is_on_axis(rows: ObservationEquations, joint: str) -> bool:
    """Return whether a turn of a joint moves the probe in no pose."""
    campaign = rows.adjustment.network.campaign
    by_angles = rows.each_tool(
        lambda geometry, chosen: (
            probe_derivatives(geometry, rows.block.angles_rad[chosen]).by_angles
        )
    )
    moved_mm = np.linalg.norm(
        by_angles[:, :, campaign.joint_names.index(joint)], axis=1
    )
    return bool(np.max(moved_mm, initial=0.0) < _ON_AXIS_MM)


POWER = 0.95
# Of the bank of all names: its share of the level of a diagnosis.
_FAMILY_LEVEL = 0.005


def detectable(
    rows: ObservationEquations,
    bank: Bank,
    absent: Sequence[tuple[Candidate, str]] = (),
    log_p: float | None = None,
) -> tuple[Detectable, ...]:
    """Compute the minimal detectable size of every candidate of a bank of names.

    After them come the absent ones, which have no columns, with the reason. The
    threshold of the bank is a natural logarithm; default Bonferroni's.
    """
    if log_p is None:
        log_p = float(np.log(_FAMILY_LEVEL / max(len(bank.candidates), 1)))
    bank = _of_own_keys(bank)
    sigma = np.sqrt(rows.sum_of_squares / max(rows.redundancy, 1)) or 1.0
    projected = project(rows, bank)
    amplitudes = np.zeros((bank.columns.shape[1], len(projected)))
    sizes = np.zeros((len(projected), 2))
    for index, (entry, part) in enumerate(zip(projected, bank.slices, strict=True)):
        if len(entry.singular_values):
            root = _root_of_needed(len(entry.singular_values), rows.redundancy, log_p)
            least_sizes = sigma * root / entry.singular_values
            directions = entry.combinations * np.array(entry.candidate.scales)[:, None]
            along = least_sizes * np.linalg.norm(directions, axis=0)
            worst = int(np.argmax(along))
            amplitudes[part, index] = least_sizes[worst] * entry.combinations[:, worst]
            sizes[index] = along[worst], along.min()
    probe_mm = left_at_probe_mm(rows, bank.columns @ amplitudes)
    lengths = np.linalg.norm(bank.columns, axis=0)
    moved = [np.linalg.norm(lengths[part]) for part in bank.slices]
    return (
        *(
            _entry(
                rows, entry, sizes[index], float(probe_mm[index]), float(moved[index])
            )
            for index, entry in enumerate(projected)
        ),
        *(_unseen(candidate, why) for candidate, why in absent),
    )


def _of_own_keys(bank: Bank) -> Bank:
    """Leave out first moments of mass, which have no size of their own to find."""
    candidates, kept = [], []
    for candidate, part in zip(bank.candidates, bank.slices, strict=True):
        keys = EFFECT_KINDS[candidate.kind].keys
        is_of_effect = [name.partition(".")[0] in keys for name in candidate.parameters]
        parameters = tuple(compress(candidate.parameters, is_of_effect))
        scales = tuple(compress(candidate.scales, is_of_effect))
        candidates.append(replace(candidate, parameters=parameters, scales=scales))
        kept += np.arange(part.start, part.stop)[is_of_effect].tolist()
    return Bank(tuple(candidates), bank.columns[:, kept])


def left_at_probe_mm(rows: ObservationEquations, changes: Floats) -> Floats:
    """Compute the error of the probe [mm] from undetected effects, rms, (n_effects,).

    They change the rows by (n_rows, n_effects). The arm is estimated as if they were
    not; what remains at the campaign's poses, less a motion of everything together, is
    the error of the arm. Surfaces show only the part along their normals; orientations
    say nothing of where the probe is.
    """
    left, values, right = np.linalg.svd(rows.columns, full_matrices=False)
    seen = values > LEAST_EFFECT
    estimates = right[seen].T @ ((left[:, seen].T @ changes) / values[seen, np.newaxis])
    stations = rows.adjustment.network.stations
    n_arm = rows.columns.shape[1] - sum(len(station.scales) for station in stations)
    off = changes - rows.columns[:, :n_arm] @ estimates[:n_arm]
    if rows.root is not None:
        off = rows.root @ off
    touching = (rows.poses >= 0) & ~np.any(rows.by_turn, axis=1)
    poses, of_row = np.unique(rows.poses[touching], return_inverse=True)
    by_centre = rows.by_centre[touching]
    squares = np.zeros((len(poses), 3, 3))
    np.add.at(squares, of_row, by_centre[:, :, np.newaxis] * by_centre[:, np.newaxis])
    along = np.zeros((len(poses), 3, changes.shape[1]))
    np.add.at(along, of_row, by_centre[:, :, np.newaxis] * off[touching, np.newaxis])
    inverses = np.linalg.pinv(squares, rcond=1e-9, hermitian=True)
    moves = (inverses @ along).reshape(3 * len(poses), -1)
    places_mm = rows.each_tool(
        lambda geometry, chosen: probe_centre(geometry, rows.block.angles_rad[chosen])
    )[poses]
    # By 1 mm along and 1 mrad about each axis.
    rigid = motions(places_mm, N_RIGID) * np.repeat([1.0, 1e-3], 3)
    rigid = (inverses @ squares @ rigid).reshape(len(moves), N_RIGID)
    moves = moves - rigid @ np.linalg.lstsq(rigid, moves, rcond=1e-9)[0]
    rms_mm: Floats = np.sqrt(np.sum(moves**2, axis=0) / max(len(poses), 1))
    return rms_mm


def _root_of_needed(degrees: int, redundancy: int, log_p: float) -> float:
    """Compute sqrt(lambda_0): found with the power at the level, variance unknown."""
    spare = max(redundancy - degrees, 1)
    critical = special.fdtri(degrees, spare, -np.expm1(log_p))
    needed = special.ncfdtrinc(degrees, spare, 1.0 - POWER, critical)
    return float(np.sqrt(needed))


def _entry(
    rows: ObservationEquations,
    projected: ProjectedCandidate,
    sizes: Floats,
    probe_mm: float,
    moved: float,
) -> Detectable:
    candidate = projected.candidate
    if not len(projected.singular_values):
        return _unseen(candidate, reason(rows, candidate, moved))
    key = _own_key(candidate)
    worst, best = (Size(size, key_unit(key)) for size in sizes.tolist())
    return Detectable(
        candidate=candidate, key=key, minimum=worst, best=best, probe_mm=probe_mm
    )


def _unseen(candidate: Candidate, why: str) -> Detectable:
    # Candidates without columns: as computed from a block of poses.
    why = why.replace("the block has", "the campaign has")
    return Detectable(candidate=candidate, key=_own_key(candidate), why=why or None)


def _own_key(candidate: Candidate) -> str:
    return candidate.parameters[0].partition(".")[0]


def planned(campaign: Campaign, arm: Arm) -> tuple[Detectable, ...]:
    """Return how large effects must be for a campaign to show them.

    Its noise, or usual noise, counts; effects of the arm are estimated too.

    Raises:
        IdentificationError: The campaign lacks data that the arm's effects need.
    """
    rows = planned_equations(campaign, arm)
    return detectable(rows, library_bank(rows, arm), absent_candidates(rows, arm))


def planned_equations(campaign: Campaign, arm: Arm) -> ObservationEquations:
    """Set up the rows of a campaign at the given arm, without misclosures."""
    problem = Problem.of(campaign, arm, Options(free_effects=True))
    network, design = problem.network(), problem.design
    adjustment = adjust(network, network.start(design), design, None, 0)
    rows = equations_of(adjustment)
    return replace(rows, values=np.zeros(len(rows.values)))
