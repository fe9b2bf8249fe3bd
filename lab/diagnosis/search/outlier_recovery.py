"""Readmission: poses that were left out as blunders, but that a curve explains.

To a model that lacks a bump in one joint, the poses on the bump look like blunders. So
both explanations are put side by side, over all poses at once:

    values = A d + C nabla + S b + e

with S the shifts of the poses left out. Every curve C may choose anew who is left out
beside it (`mean_shifts`); it is believed if what it lowers the cost by passes the test
of its bank. Blunders anywhere cost as much with the curve as without.
"""

from collections.abc import Collection
from dataclasses import replace

import numpy as np
from scipy import special  # type: ignore[import-untyped] # scipy ships no types

from traverse.arrays import Booleans
from traverse.lab.diagnosis.candidates.curves import generic_bank
from traverse.lab.diagnosis.candidates.scoring import (
    ProjectedCandidate,
    log_p_values,
    project,
)
from traverse.lab.diagnosis.model.fit import Fit
from traverse.lab.diagnosis.model.observation_equations import (
    ObservationEquations,
    equations_of,
)
from traverse.lab.diagnosis.search.mean_shifts import (
    MeanShifts,
    best_mean_shifts,
    pose_groups,
)
from traverse.lab.diagnosis.search.selection import has_own_curve
from traverse.lab.identification.equations.network import stations
from traverse.lab.identification.solve.options import Options
from traverse.lab.identification.solve.snooping import robust_scale


def recover_outliers(
    fit: Fit,
    eligible: Booleans,
    log_p: float,
    joints_with_own_curve: Collection[str] = (),
) -> Booleans | None:
    """Find who takes part if the best curve is right.

    Args:
        fit: That left out some poses.
        eligible: Poses that may take part, (n_poses,).
        log_p: Below which a curve is believed.
        joints_with_own_curve: Joints whose own angle has an empirical curve already.

    Returns:
        Who takes part, (n_poses,); None: no curve explains why poses were left out.
    """
    outside = eligible & ~fit.included
    if not np.any(outside):
        return None
    rows = equations_of_all_poses(fit, eligible)
    groups = pose_groups(rows, _limits(fit, rows))
    plain = best_mean_shifts(groups, rows.basis, rows.residuals, outside)
    start = _mask(eligible, plain)
    chosen, least = None, log_p
    for curve in project(rows, generic_bank(rows)):
        if has_own_curve(curve.candidate, joints_with_own_curve):
            continue
        along = curve.directions.T @ rows.residuals
        # Most curves explain none of them: no need to look further.
        if np.all(plain.statistics_with(curve.directions, along) > plain.limits):
            continue
        basis = np.hstack([rows.basis, curve.directions])
        residuals = rows.residuals - curve.directions @ along
        found = best_mean_shifts(groups, basis, residuals, start)
        reached = _log_p(rows, plain, found, curve)
        if reached < least and np.any(start & ~_mask(eligible, found)):
            chosen, least = found, reached
    return None if chosen is None else eligible & ~_mask(eligible, chosen)


def equations_of_all_poses(fit: Fit, eligible: Booleans) -> ObservationEquations:
    """Linearise the equations of all poses where a fit to some of them ended.

    An artefact that took no part at all stays away.
    """
    network, state = fit.adjustment.network, fit.adjustment.state
    n_poses, n_joints = network.campaign.poses.angles_rad.shape
    unknowns, corrections = {}, np.zeros((n_poses, n_joints + 3))
    for station, own, of_poses in zip(
        network.stations, state.unknowns, state.corrections, strict=True
    ):
        unknowns[station.index] = own
        corrections[station.poses] = of_poses
    known = tuple(
        station
        for station in stations(network.campaign, fit.arm.probe.radius_mm, eligible)
        if station.index in unknowns
    )
    everyone = replace(
        state,
        unknowns=tuple(unknowns[station.index] for station in known),
        corrections=tuple(corrections[station.poses] for station in known),
    )
    return equations_of(
        replace(
            fit.adjustment, network=replace(network, stations=known), state=everyone
        )
    )


def _limits(fit: Fit, rows: ObservationEquations) -> dict[int, float]:
    """Say at which statistic a pose is left out, by the number of its rows."""
    poses, sizes = np.unique(rows.poses[rows.poses >= 0], return_counts=True)
    level = Options().family_level / len(poses)
    variance = max(robust_scale(fit.statistics), 1.0) ** 2
    return {
        int(size): variance * float(special.chdtri(size, level))
        for size in np.unique(sizes)
    }


def _log_p(
    rows: ObservationEquations,
    plain: MeanShifts,
    found: MeanShifts,
    curve: ProjectedCandidate,
) -> float:
    """Test a curve by what it lowers the cost by; as ever if nobody comes back."""
    gain = max(plain.cost - found.cost, 0.0)
    redundancy = rows.redundancy - len(found.rows)
    part = np.array([gain / (gain + found.sum_of_squares)])
    degrees = np.array([len(curve.singular_values)])
    return float(log_p_values(part, degrees, redundancy)[0])


def _mask(eligible: Booleans, shifts: MeanShifts) -> Booleans:
    found = np.zeros_like(eligible)
    found[shifts.poses] = True
    return found
