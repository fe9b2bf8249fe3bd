"""What would have been seen: the smallest size of every effect, and what it may do.

An effect of the size nabla gives the F test of its block the non-centrality
lambda = |P C nabla|^2. With lambda_0 that is found with a power of 95 % at the level
at which a bank is judged, and the singular values s of the projected block,

    minimal detectable size = sqrt(lambda_0) / s

for the direction in which the block is weakest and for the strongest (Baarda's
internal reliability). What such an effect, not found, does to the calibrated arm is
its move of the probe, less what the estimated arm takes of it (external reliability).
"""

from collections.abc import Sequence

import numpy as np
from scipy import special  # type: ignore[import-untyped] # scipy ships no types

from traverse.arrays import Floats
from traverse.kinematics.effect_table import key_unit
from traverse.kinematics.model.forward import probe_centre
from traverse.lab.diagnosis.advice.invisibility import reason
from traverse.lab.diagnosis.candidates.scoring import ProjectedCandidate, project
from traverse.lab.diagnosis.model.candidate import Bank, Candidate
from traverse.lab.diagnosis.model.observation_equations import ObservationEquations
from traverse.lab.diagnosis.model.result import Detectable

POWER = 0.95
# Of the bank of all names: its share of the level of a diagnosis.
_FAMILY_LEVEL = 0.005
_LEAST_EFFECT = 0.02


def detectable(
    rows: ObservationEquations,
    bank: Bank,
    absent: Sequence[tuple[Candidate, str]] = (),
    log_p: float | None = None,
) -> tuple[Detectable, ...]:
    """Say of every candidate how large it must be to be seen.

    Args:
        rows: Of the fit that is final, or of a planned campaign.
        bank: Of names.
        absent: Names that have no columns, with the reason.
        log_p: Threshold of the bank, natural logarithm; default Bonferroni's.

    Returns:
        In the order of the bank, then the absent ones.
    """
    if log_p is None:
        log_p = float(np.log(_FAMILY_LEVEL / max(len(bank.candidates), 1)))
    sigma = np.sqrt(rows.sum_of_squares / max(rows.redundancy, 1)) or 1.0
    projected = project(rows, bank)
    amplitudes = np.zeros((bank.columns.shape[1], len(projected)))
    sizes = np.zeros((len(projected), 2))
    for at, (one, part) in enumerate(zip(projected, bank.slices, strict=True)):
        if len(one.singular_values):
            root = _root_of_needed(len(one.singular_values), rows.redundancy, log_p)
            found = sigma * root / one.singular_values
            directions = one.combinations * np.array(one.candidate.scales)[:, None]
            along = found * np.linalg.norm(directions, axis=0)
            worst = int(np.argmax(along))
            amplitudes[part, at] = found[worst] * one.combinations[:, worst]
            sizes[at] = along[worst], along.min()
    probe_mm = left_at_probe_mm(rows, bank.columns @ amplitudes)
    lengths = np.linalg.norm(bank.columns, axis=0)
    moved = [np.linalg.norm(lengths[part]) for part in bank.slices]
    return (
        *(
            _entry(rows, one, sizes[at], float(probe_mm[at]), float(moved[at]))
            for at, one in enumerate(projected)
        ),
        *(_unseen(candidate, why) for candidate, why in absent),
    )


def left_at_probe_mm(rows: ObservationEquations, changes: Floats) -> Floats:
    """Say how far the probe is off where effects are there and not known of.

    The arm is estimated as if they were not; what remains at the campaign's poses,
    less a motion of everything together, is the error of the arm. Surfaces show only
    the part along their normals.

    Args:
        rows: Of the fit.
        changes: What the effects do to the rows, (n_rows, n_effects).

    Returns:
        Root mean squares, (n_effects,).
    """
    left, values, right = np.linalg.svd(rows.columns, full_matrices=False)
    seen = values > _LEAST_EFFECT
    estimates = right[seen].T @ ((left[:, seen].T @ changes) / values[seen, np.newaxis])
    stations = rows.adjustment.network.stations
    n_arm = rows.columns.shape[1] - sum(len(station.scales) for station in stations)
    off = changes - rows.columns[:, :n_arm] @ estimates[:n_arm]
    if rows.root is not None:
        off = rows.root @ off
    touching = rows.poses >= 0
    poses, of_row = np.unique(rows.poses[touching], return_inverse=True)
    by_centre = rows.by_centre[touching]
    squares = np.zeros((len(poses), 3, 3))
    np.add.at(squares, of_row, by_centre[:, :, np.newaxis] * by_centre[:, np.newaxis])
    along = np.zeros((len(poses), 3, changes.shape[1]))
    np.add.at(along, of_row, by_centre[:, :, np.newaxis] * off[touching, np.newaxis])
    inverses = np.linalg.pinv(squares, rcond=1e-9, hermitian=True)
    moves = (inverses @ along).reshape(3 * len(poses), -1)
    geometry = rows.adjustment.state.arm.geometry
    places_mm = probe_centre(geometry, rows.block.angles_rad[poses])
    rigid = (inverses @ squares @ _rigid_motions(places_mm)).reshape(len(moves), 6)
    moves = moves - rigid @ np.linalg.lstsq(rigid, moves, rcond=1e-9)[0]
    found: Floats = np.sqrt(np.sum(moves**2, axis=0) / max(len(poses), 1))
    return found


def _rigid_motions(places_mm: Floats) -> Floats:
    """Compute moves by 1 mm along and 1 mrad about each axis, (n, 3, 6)."""
    turned = np.cross(np.eye(3)[np.newaxis], places_mm[:, np.newaxis]) * 1e-3
    shifted = np.broadcast_to(np.eye(3), turned.shape)
    return np.concatenate([shifted, turned.swapaxes(1, 2)], axis=2)


def _root_of_needed(degrees: int, redundancy: int, log_p: float) -> float:
    """Compute sqrt(lambda_0): found with the power at the level, variance unknown."""
    spare = max(redundancy - degrees, 1)
    critical = special.fdtri(degrees, spare, -np.expm1(log_p))
    needed = special.ncfdtrinc(degrees, spare, 1.0 - POWER, critical)
    return float(np.sqrt(needed))


def _entry(
    rows: ObservationEquations,
    one: ProjectedCandidate,
    sizes: Floats,
    probe_mm: float,
    moved: float,
) -> Detectable:
    candidate = one.candidate
    if not len(one.singular_values):
        return _unseen(candidate, reason(rows, candidate, moved))
    key = candidate.parameters[0].partition(".")[0]
    worst, best = (float(size) for size in sizes)
    return Detectable(candidate, key, worst, best, key_unit(key), probe_mm, "")


def _unseen(candidate: Candidate, why: str) -> Detectable:
    # What has no columns is told as a block of poses sees it.
    why = why.replace("the block has", "the campaign has")
    key = candidate.parameters[0].partition(".")[0]
    return Detectable(candidate, key, None, None, key_unit(key), 0.0, why)
