"""Measured against simulated: by other formulas, and where something is planted."""

import csv
from dataclasses import replace

import numpy as np
import pytest

from tests.lab.diagnosis.fitted_rows import measured
from tests.lab.simulated import TrueArm
from traverse.lab.diagnosis.model.fit import Fit, fitted
from traverse.lab.diagnosis.report.discrepancies import (
    discrepancies,
    write_discrepancies,
)

CONE = 2


@pytest.fixture(scope="module")
def fit() -> Fit:
    case = measured()
    eligible = np.ones(len(case.campaign.poses), dtype=np.bool_)
    # A third of the poses takes no part, the first cone none at all.
    eligible[::3] = False
    eligible[case.campaign.poses.artefacts == 0] = False
    return fitted(case.campaign, case.arm, eligible)


@pytest.fixture(scope="module")
def compared(fit):
    return discrepancies(fit.adjustment)


def simulated_arm(fit) -> TrueArm:
    geometry = fit.adjustment.state.arm.geometry
    return TrueArm(
        geometry.axes, geometry.links_mm, geometry.zeros_rad, geometry.origin_mm
    )


def slopes_mm(arm: TrueArm, angles_rad) -> np.ndarray:
    """dx/dalpha by differences, (n_poses, 3, n_joints)."""
    ways = 1e-6 * np.eye(angles_rad.shape[1])
    return np.stack(
        [
            (arm.centres(angles_rad + w) - arm.centres(angles_rad - w)) / 2e-6
            for w in ways
        ],
        axis=2,
    )


def test_a_misclosure_is_where_the_simulation_puts_the_ball(fit, compared):
    poses = compared.campaign.poses
    centres_mm = simulated_arm(fit).centres(poses.angles_rad)
    for artefact in (0, CONE):
        mine = poses.artefacts == artefact
        seats_mm = centres_mm[mine] - compared.misclosures_mm[mine]
        assert np.ptp(seats_mm, axis=0).max() < 1e-9


def test_an_artefact_that_took_no_part_stands_where_its_poses_say(compared):
    mine = compared.campaign.poses.artefacts == 0
    assert not compared.took_part[mine].any()
    # The middle of the poses, whatever single ones do.
    middle_mm = np.median(compared.misclosures_mm[mine], axis=0)
    assert np.abs(middle_mm).max() < 1e-9


def test_surfaces_have_one_misclosure_and_cones_three(compared):
    counts = np.isfinite(compared.misclosures_mm).sum(axis=1)
    kinds = [
        compared.campaign.artefacts[a].kind for a in compared.campaign.poses.artefacts
    ]
    assert [3 if kind == "cone" else 1 for kind in kinds] == counts.tolist()


def test_an_amount_is_the_best_one_for_the_noise_of_the_pose(fit, compared):
    noise = fit.adjustment.network.noise
    poses = compared.campaign.poses
    mine = np.flatnonzero(poses.artefacts == CONE)
    slopes = slopes_mm(simulated_arm(fit), poses.angles_rad[mine])
    way = np.array([0.6, 0.0, 0.8])
    amounts, stds = compared.along(np.broadcast_to(way, (len(poses), 3)))
    for slope, at in zip(slopes, mine, strict=True):
        scaled = slope * noise.encoder_rad
        dispersion = scaled @ scaled.T + noise.contact_mm[CONE] ** 2 * np.eye(3)
        weighed = np.linalg.solve(dispersion, way)
        information = way @ weighed
        # What is measured is ahead of the simulation by less its misclosure.
        expected_mm = -(weighed @ compared.misclosures_mm[at]) / information
        assert amounts[at] == pytest.approx(expected_mm, rel=1e-5, abs=1e-9)
        assert stds[at] == pytest.approx(1.0 / np.sqrt(information), rel=1e-5)
        whitened = compared.misclosures_mm[at] @ np.linalg.solve(
            dispersion, compared.misclosures_mm[at]
        )
        assert compared.sizes[at] == pytest.approx(np.sqrt(whitened / 3.0), rel=1e-5)


def test_a_reading_that_is_too_large_shows_as_just_that(fit, compared):
    network = fit.adjustment.network
    poses = compared.campaign.poses
    angles_rad = poses.angles_rad.copy()
    spoilt = np.flatnonzero(poses.artefacts == CONE)[:5]
    angles_rad[spoilt, 2] += 4e-5
    campaign = replace(compared.campaign, poses=replace(poses, angles_rad=angles_rad))
    changed = discrepancies(
        replace(fit.adjustment, network=replace(network, campaign=campaign))
    )
    before_rad, _ = compared.reading_errors_rad(2)
    after_rad, _ = changed.reading_errors_rad(2)
    assert np.allclose(after_rad[spoilt] - before_rad[spoilt], 4e-5, rtol=2e-3)
    unchanged = np.setdiff1d(np.flatnonzero(poses.artefacts == CONE), spoilt)
    assert np.array_equal(after_rad[unchanged], before_rad[unchanged])


def test_a_move_of_the_ball_is_told_as_the_reading_that_does_the_same(fit, compared):
    poses = compared.campaign.poses
    slopes = slopes_mm(simulated_arm(fit), poses.angles_rad)
    # A reading that is 10 urad too large is taken back by a move of the model's ball.
    moves_mm = -1e-5 * slopes[:, :, 3]
    assert np.allclose(compared.as_reading_rad(3, moves_mm), 1e-5, rtol=1e-5)


def test_noise_explains_what_is_left_where_nothing_is_hidden(compared):
    mean_square = (
        np.sum(compared.whitened**2) / np.isfinite(compared.misclosures_mm).sum()
    )
    assert 0.8 < mean_square < 1.25


def test_other_noise_changes_the_units_only(fit, compared):
    noise = fit.adjustment.network.noise
    twice = replace(
        noise, encoder_rad=2 * noise.encoder_rad, contact_mm=2 * noise.contact_mm
    )
    in_larger_units = discrepancies(fit.adjustment, twice)
    assert np.allclose(2 * in_larger_units.sizes, compared.sizes)
    seen = np.isfinite(compared.misclosures_mm)
    assert np.array_equal(
        in_larger_units.misclosures_mm[seen], compared.misclosures_mm[seen]
    )


def test_the_table_has_a_line_a_pose(compared, tmp_path):
    n_poses = len(compared.campaign.poses)
    path = tmp_path / "discrepancies.csv"
    write_discrepancies(path, compared, compared, ("choosing",) * n_poses)
    with path.open() as file:
        rows = list(csv.DictReader(file))
    assert [int(row["line"]) for row in rows] == compared.campaign.poses.lines.tolist()
    on_bar = next(row for row in rows if row["artefact"] == "bar")
    assert on_bar["before_2_mm"] == ""
    assert on_bar["feature"] in ("1", "2")
    errors_rad, _ = compared.reading_errors_rad(4)
    printed_rad = [float(row["after_J5_rad"]) for row in rows]
    assert np.allclose(printed_rad, errors_rad, rtol=1e-4)
