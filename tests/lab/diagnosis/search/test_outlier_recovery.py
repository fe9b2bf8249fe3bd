"""Poses that look like blunders only because the model lacks something there."""

import numpy as np
import pytest

from tests.lab.diagnosis.engine_campaigns import (
    DECISION,
    SEED,
    hidden,
    measured_with,
    poses,
)
from traverse.lab.campaign.holdout import split
from traverse.lab.diagnosis.candidates.curves import generic_bank
from traverse.lab.diagnosis.candidates.scoring import project
from traverse.lab.diagnosis.diagnose import diagnose
from traverse.lab.diagnosis.model.fit import fitted
from traverse.lab.diagnosis.search.outlier_recovery import (
    best_mean_shifts,
    equations_of_all_poses,
    pose_groups,
    recover_outliers,
    shifted,
)

# Statistics at which poses of three rows and of one are left out.
LIMITS = {3: 28.0, 1: 20.0}
# Natural logarithm of a p-value that the bank of curves requires.
BELIEVED = -11.5


def fit_of(campaign):
    choosing, _ = split(campaign, SEED)
    return fitted(campaign, poses().arm, choosing), choosing


@pytest.mark.slow
@pytest.mark.parametrize(("joint", "draw", "size"), [("J3", 9, 30.0), ("J5", 7, 15.0)])
def test_a_narrow_bump_is_not_taken_for_blunders(joint, draw, size):
    wrong = hidden("bump", size, joint, draw)
    campaign = measured_with(wrong)
    fit, choosing = fit_of(campaign)
    on_it = np.abs(
        campaign.poses.angles_rad[:, int(joint[1]) - 1] - wrong.fault.middle_rad
    )
    left_out = choosing & ~fit.included
    # All that the fit without it leaves out are its best witnesses.
    assert left_out.sum() >= 3
    assert np.all(on_it[left_out] < wrong.fault.half_width_rad)
    diagnosis = diagnose(campaign, poses().arm, DECISION)
    assert diagnosis.verdict == "unknown"
    (term,) = diagnosis.terms
    assert (term.candidate.joint, term.candidate.covariate) == (joint, f"{joint}_rad")
    assert term.accepted
    assert diagnosis.gap.closed > 0.7
    assert diagnosis.excluded.sum() <= 2


@pytest.mark.parametrize("seed", [6, 7, 8])
def test_blunders_at_random_stay_out(seed):
    fit, choosing = fit_of(measured_with(seed=seed, blunder_share=0.05))
    assert np.any(choosing & ~fit.included)
    assert recover_outliers(fit, choosing, BELIEVED) is None


def test_without_blunders_there_is_nothing_to_readmit():
    fit, choosing = fit_of(measured_with())
    assert np.array_equal(fit.included, choosing)
    assert recover_outliers(fit, choosing, BELIEVED) is None


def problem():
    """Rows of all poses with three blunders in them, whose fit they do not touch."""
    campaign = measured_with(seed=3)
    fit, choosing = fit_of(campaign)
    rows = equations_of_all_poses(fit, choosing)
    groups = pose_groups(rows, LIMITS)
    spoilt = np.zeros(len(campaign.poses), dtype=np.bool_)
    spoilt[[groups[0].poses[4], groups[0].poses[40], groups[1].poses[7]]] = True
    values = rows.residuals.copy()
    rng = np.random.default_rng(5)
    for row in np.flatnonzero(spoilt[rows.poses] & (rows.poses >= 0)):
        values[row] += 20.0 * rng.choice([-1.0, 1.0])
    return rows, groups, rows.project(values[:, np.newaxis])[:, 0], spoilt


def test_shifts_are_those_of_least_squares():
    rows, groups, residuals, spoilt = problem()
    shifts = shifted(groups, rows.basis, residuals, spoilt)
    columns = np.zeros((len(residuals), len(shifts.rows)))
    columns[shifts.rows, np.arange(len(shifts.rows))] = 1.0
    design = np.hstack([rows.basis, columns])
    solution, *_ = np.linalg.lstsq(design, residuals, rcond=None)
    left = residuals - design @ solution
    np.testing.assert_allclose(shifts.sizes, solution[rows.basis.shape[1] :], atol=1e-9)
    assert shifts.sum_of_squares == pytest.approx(left @ left)
    assert shifts.cost == pytest.approx(left @ left + 2 * 28.0 + 20.0)
    # Taking one shift away raises the squares by its statistic.
    for index, pose in enumerate(shifts.poses):
        fewer = spoilt.copy()
        fewer[pose] = False
        more = shifted(groups, rows.basis, residuals, fewer).sum_of_squares
        assert more - shifts.sum_of_squares == pytest.approx(shifts.statistics[index])


def test_blunders_are_found_from_any_start():
    rows, groups, residuals, spoilt = problem()
    rng = np.random.default_rng(2)
    for start in (spoilt, np.zeros_like(spoilt), rng.random(len(spoilt)) < 0.05):
        shifts = best_mean_shifts(groups, rows.basis, residuals, start)
        assert set(shifts.poses) == set(np.flatnonzero(spoilt))
        assert np.all(shifts.statistics > shifts.limits)


def test_statistics_beside_a_curve_are_those_of_a_basis_with_it():
    rows, groups, residuals, spoilt = problem()
    plain = shifted(groups, rows.basis, residuals, spoilt)
    for curve in project(rows, generic_bank(rows))[::9]:
        along = curve.directions.T @ residuals
        basis = np.hstack([rows.basis, curve.directions])
        left = residuals - curve.directions @ along
        expected = shifted(groups, basis, left, spoilt).statistics
        updated = plain.statistics_with(curve.directions, along)
        np.testing.assert_allclose(updated, expected, rtol=1e-6)
