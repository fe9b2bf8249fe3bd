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
from numpy.typing import NDArray
from scipy import special  # type: ignore[import-untyped] # scipy ships no types

from traverse.lab.diagnosis.candidates.curves import generic_bank
from traverse.lab.diagnosis.candidates.scoring import Projected, log_p_values, project
from traverse.lab.diagnosis.model.fit import Fit
from traverse.lab.diagnosis.model.observation_equations import Rows, rows_of
from traverse.lab.diagnosis.search.mean_shifts import Shifts, best_shifts, groups_of
from traverse.lab.diagnosis.search.selection import is_settled
from traverse.lab.identification.equations.network import stations
from traverse.lab.identification.solve.options import Options
from traverse.lab.identification.solve.snooping import robust_scale

Floats = NDArray[np.float64]
Booleans = NDArray[np.bool_]


def readmitted(
    fit: Fit, eligible: Booleans, log_p: float, settled: Collection[str] = ()
) -> Booleans | None:
    """Find who takes part if the best curve is right.

    Args:
        fit: That left out some poses.
        eligible: Poses that may take part, (n_poses,).
        log_p: Below which a curve is believed.
        settled: Joints whose own angle has an empirical curve already.

    Returns:
        Who takes part, (n_poses,); None: no curve explains why poses were left out.
    """
    outside = eligible & ~fit.included
    if not np.any(outside):
        return None
    rows = rows_of_all(fit, eligible)
    groups = groups_of(rows, _limits(fit, rows))
    plain = best_shifts(groups, rows.basis, rows.residuals, outside)
    start = _mask(eligible, plain)
    chosen, least = None, log_p
    for curve in project(rows, generic_bank(rows)):
        if is_settled(curve.candidate, settled):
            continue
        along = curve.directions.T @ rows.residuals
        # Most curves explain none of them: no need to look further.
        if np.all(plain.statistics_beside(curve.directions, along) > plain.limits):
            continue
        basis = np.hstack([rows.basis, curve.directions])
        residuals = rows.residuals - curve.directions @ along
        found = best_shifts(groups, basis, residuals, start)
        reached = _log_p(rows, plain, found, curve)
        if reached < least and np.any(start & ~_mask(eligible, found)):
            chosen, least = found, reached
    return None if chosen is None else eligible & ~_mask(eligible, chosen)


def rows_of_all(fit: Fit, eligible: Booleans) -> Rows:
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
    return rows_of(
        replace(
            fit.adjustment, network=replace(network, stations=known), state=everyone
        )
    )


def _limits(fit: Fit, rows: Rows) -> dict[int, float]:
    """Say at which statistic a pose is left out, by the number of its rows."""
    poses, sizes = np.unique(rows.poses[rows.poses >= 0], return_counts=True)
    level = Options().family_level / len(poses)
    variance = max(robust_scale(fit.statistics), 1.0) ** 2
    return {
        int(size): variance * float(special.chdtri(size, level))
        for size in np.unique(sizes)
    }


def _log_p(rows: Rows, plain: Shifts, found: Shifts, curve: Projected) -> float:
    """Test a curve by what it lowers the cost by; as ever if nobody comes back."""
    gain = max(plain.cost - found.cost, 0.0)
    redundancy = rows.redundancy - len(found.rows)
    part = np.array([gain / (gain + found.sum_of_squares)])
    degrees = np.array([len(curve.singular_values)])
    return float(log_p_values(part, degrees, redundancy)[0])


def _mask(eligible: Booleans, shifts: Shifts) -> Booleans:
    found = np.zeros_like(eligible)
    found[shifts.poses] = True
    return found
