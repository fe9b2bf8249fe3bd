"""Running sums over gaps against columns that are built one by one."""

import numpy as np
import pytest

from tests.lab.diagnosis.fitted_rows import measured, measured_rows, serial_rows
from traverse.kinematics.effects.arm_effects import effects_of
from traverse.kinematics.effects.pose import corrected_pose
from traverse.lab.diagnosis.candidates.scoring import judge, log_evidences, project
from traverse.lab.diagnosis.candidates.steps import (
    scan_steps,
    step_bank,
    step_candidate,
    step_columns,
)
from traverse.lab.diagnosis.model.candidate import Bank, effect_of_candidate
from traverse.lab.diagnosis.model.observation_equations import equations_of

SOME_GAPS = (0, 1, 57, 120, 238)
ROWS = pytest.mark.parametrize("rows_are", [measured_rows, serial_rows])


def test_there_is_a_gap_between_any_two_poses():
    rows = measured_rows()
    times_s = np.sort(measured().campaign.poses.time_s[rows.used_poses])
    for scan in scan_steps(rows):
        np.testing.assert_allclose(scan.at_s, (times_s[1:] + times_s[:-1]) / 2)
    names = [scan.joint for scan in scan_steps(rows)]
    assert names == [*measured().campaign.joint_names, None]


@pytest.mark.parametrize("joint", ["J3", None])
def test_step_columns_are_the_difference_of_the_whole_model(joint):
    rows = measured_rows()
    at_s = 400.0
    candidate = step_candidate(joint, at_s)
    columns = step_columns(rows, joint, at_s)
    geometry = rows.adjustment.state.arm.geometry
    span = measured().campaign.span
    for column in range(candidate.size):
        sizes = np.eye(candidate.size)[column] * candidate.scales
        moved = []
        for sign in (1.0, -1.0):
            effect = effect_of_candidate(candidate, sign * sizes, rows)
            effects = effects_of(measured().arm, (effect,), span)
            moved.append(corrected_pose(geometry, effects, rows.block)[0])
        expected = rows.moved((moved[0] - moved[1])[:, :, np.newaxis] / 2)[:, 0]
        assert np.any(expected == 0.0)
        np.testing.assert_allclose(
            columns[:, column], expected, atol=1e-4 * np.abs(expected).max()
        )


@ROWS
def test_every_gap_is_judged_as_if_it_were_alone(rows_are):
    rows = rows_are()
    for scan in scan_steps(rows):
        for gap in SOME_GAPS:
            at_s = float(scan.at_s[gap])
            columns = step_columns(rows, scan.joint, at_s)
            bank = Bank((step_candidate(scan.joint, at_s),), columns)
            alone = judge(rows, project(rows, bank))
            assert scan.statistics[gap] == pytest.approx(alone.statistics[0], rel=1e-6)
            assert scan.evidences[gap] == pytest.approx(alone.evidences[0], rel=1e-6)
            np.testing.assert_allclose(
                np.sort(scan.singular_values[gap]),
                np.sort(alone.projected[0].singular_values),
                rtol=1e-6,
            )


@ROWS
def test_many_residuals_are_scanned_like_those_of_the_fit(rows_are):
    rows = rows_are()
    noise = np.random.default_rng(1).standard_normal((len(rows.values), 5))
    draws = np.column_stack([rows.residuals, rows.project(noise)])
    for scan in (scan_steps(rows)[1], scan_steps(rows)[-1]):
        largest, size = scan.largest(draws)
        assert size == (3 if scan.joint is None else 1)
        assert largest[0] == pytest.approx(scan.statistics.max())
        gap = int(np.argmax(np.sum(scan.alongs(draws)[:, :, 3] ** 2, axis=1)))
        columns = rows.project(step_columns(rows, scan.joint, scan.at_s[gap]))
        fitted = columns @ np.linalg.lstsq(columns, draws[:, 3], rcond=None)[0]
        assert largest[3] == pytest.approx(fitted @ fitted, rel=1e-6)


def test_evidence_of_an_unknown_moment_is_the_mean_over_the_moments():
    scan = scan_steps(measured_rows())[2]
    rows = measured_rows()
    again = log_evidences(
        scan.along**2, scan.singular_values**2, rows.sum_of_squares, rows.redundancy
    )
    np.testing.assert_allclose(scan.evidences, again)
    assert scan.evidence == pytest.approx(np.log(np.mean(np.exp(scan.evidences))))
    assert scan.evidence <= scan.evidences[scan.best]


def test_a_simulated_slip_is_found_where_it_happened():
    slipped_at = 100
    poses = measured().campaign.poses
    angles_rad = poses.angles_rad.copy()
    angles_rad[slipped_at:, 3] += 8e-5
    rows = measured().with_poses(angles_rad=angles_rad).rows()
    scans = scan_steps(rows)
    best = max(scans, key=lambda scan: scan.evidence)
    assert best.joint == "J4"
    # One pose earlier or later makes little difference.
    distance = np.searchsorted(poses.time_s, best.candidate.at_s) - slipped_at
    assert abs(int(distance)) <= 3
    (projection,) = project(rows, step_bank(rows, (best,)))
    values, covariance = projection.amplitudes(rows.residuals)
    assert abs(values[0] - 8e-5) < 4.0 * np.sqrt(covariance[0, 0])


def test_a_simulated_knock_of_the_base_is_found_where_it_happened():
    at_s = float(measured().campaign.poses.time_s[150]) - 0.5
    truth_mm = np.array([0.03, -0.02, 0.04])
    effect = effect_of_candidate(step_candidate(None, at_s), truth_mm, measured_rows())
    rows = measured().with_effect(effect).rows()
    best = max(scan_steps(rows), key=lambda scan: scan.evidence)
    assert best.joint is None
    assert best.at_s[best.best] == pytest.approx(at_s, abs=15.0)
    (projection,) = project(rows, step_bank(rows, (best,)))
    values, covariance = projection.amplitudes(rows.residuals)
    away = values - truth_mm
    assert away @ np.linalg.solve(covariance, away) < 25.0


def test_poses_of_one_moment_have_no_gap():
    n = len(measured().campaign.poses)
    times_s = np.repeat(np.arange(n // 2) * 5.0, 2)
    rows = equations_of(measured().with_poses(time_s=times_s).fit().adjustment)
    scan = scan_steps(rows)[-1]
    assert len(scan.at_s) == n // 2 - 1
    at_once = measured().with_poses(time_s=np.zeros(n)).rows()
    assert scan_steps(at_once) == ()
    assert step_bank(at_once, ()).columns.shape == (len(at_once.values), 0)


def test_plausible_steps_are_those_of_the_identification():
    campaign = measured().campaign
    for joint in ("J1", None):
        candidate = step_candidate(joint, 10.0)
        effect = effect_of_candidate(
            candidate, np.ones(candidate.size), measured_rows()
        )
        built = effects_of(measured().arm, (effect,), campaign.span)
        assert candidate.scales == campaign.plausible_values(built.corrections[0])
