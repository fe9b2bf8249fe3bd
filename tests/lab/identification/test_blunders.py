"""Blunders go, good poses stay; noise and starts are found from the data."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from tests.lab.simulated import (
    DESIGN_ARM,
    Noise,
    bar,
    built,
    cones,
    random_directions,
    simulate,
)
from traverse.kinematics.model.derivatives import probe_derivatives
from traverse.lab.adjustment.noise import VarianceModel
from traverse.lab.identification.identify import Options, identify

TABLES = [*cones(3), bar()]
QUICK = Options(n_suggestions=0)


def with_blunders(campaign, true, part, sigmas, seed=3):
    """Shift the ball of some poses, by turning the joints a little."""
    rng = np.random.default_rng(seed)
    n_poses = len(campaign.poses)
    bad = rng.choice(n_poses, int(part * n_poses), replace=False)
    angles = campaign.poses.angles_rad.copy()
    slopes = probe_derivatives(true.geometry(), angles[bad]).by_angles
    shifts = random_directions(rng, len(bad)) * sigmas * 0.0055
    angles[bad] += (np.linalg.pinv(slopes) @ shifts[:, :, None])[:, :, 0]
    return campaign.with_poses(angles_rad=angles), set(bad.tolist())


@cache
def of_a_clean_campaign():
    clean = simulate(built(1), TABLES, 100, 7)
    return clean, identify(clean, DESIGN_ARM, QUICK)


@pytest.mark.parametrize("part", [0.01, 0.05])
def test_blunders_of_fifteen_sigma_at_cones_are_all_removed(part):
    clean, reference = of_a_clean_campaign()
    campaign, bad = with_blunders(clean, built(1), part, 15.0)
    result = identify(campaign, DESIGN_ARM, QUICK)
    excluded = {entry.line - 2 for entry in result.excluded}
    at_cones = {at for at in bad if campaign.poses.artefacts[at] < 3}
    assert at_cones <= excluded
    # Along a sphere a blunder moves nothing that the sphere can see.
    assert all(result.statistics.w[at] < 4.3 for at in bad - excluded)
    assert len(excluded - bad) <= 1
    assert result.global_test.passed
    spread = np.sqrt(np.diag(reference.covariance))
    change = [
        spoilt.value - undisturbed.value
        for spoilt, undisturbed in zip(
            result.parameters, reference.parameters, strict=True
        )
    ]
    assert np.max(np.abs(change) / spread) < 1.5


def test_huge_blunders_do_not_take_good_poses_with_them():
    true = built(1)
    campaign, bad = with_blunders(simulate(true, TABLES, 60, 8), true, 0.08, 2000.0)
    result = identify(campaign, DESIGN_ARM, QUICK)
    excluded = {entry.line - 2 for entry in result.excluded}
    assert len(excluded - bad) <= 1
    assert len(bad - excluded) <= 2
    assert result.sigma0 < 1.2


def test_a_clean_campaign_loses_no_pose():
    campaign = simulate(built(2), TABLES, 60, 9)
    result = identify(campaign, DESIGN_ARM, QUICK)
    assert result.excluded == ()
    assert np.all(result.included)


def test_without_snooping_every_pose_stays():
    true = built(1)
    campaign, _ = with_blunders(simulate(true, TABLES, 40, 7), true, 0.05, 15.0)
    result = identify(campaign, DESIGN_ARM, replace(QUICK, snooping=False))
    assert np.all(result.included)
    assert not result.global_test.passed


def test_absent_noise_is_estimated():
    true = built(1)
    campaign = simulate(true, TABLES, 120, 10, noise=Noise(1.5e-5, 0.003))
    unknown = replace(campaign, encoder_rad=None, contact_mm=None)
    result = identify(unknown, DESIGN_ARM, QUICK)
    assert result.noise.encoder_rad == pytest.approx(1.5e-5, rel=0.2)
    assert result.noise.contact_mm[0] == pytest.approx(0.003, rel=0.5)
    assert result.sigma0 == pytest.approx(1.0, abs=0.02)
    assert result.global_test.noise_estimated


def test_noise_may_differ_between_joints():
    campaign = simulate(built(1), cones(3), 250, 11, noise=Noise(0, 0.003))
    rng = np.random.default_rng(1)
    angles = campaign.poses.angles_rad.copy()
    stds = np.array([2e-5, 2e-5, 2e-5, 2e-5, 5e-6, 5e-6, 5e-6])
    angles += rng.normal(size=angles.shape) * stds
    campaign = replace(
        campaign, poses=replace(campaign.poses, angles_rad=angles), encoder_rad=None
    )
    options = replace(QUICK, variances=VarianceModel("each", "held"))
    result = identify(campaign, DESIGN_ARM, options)
    assert result.noise.encoder_rad[[0, 1, 3]] == pytest.approx(2e-5, rel=0.35)
    assert result.noise.contact_mm == pytest.approx(0.003)


@pytest.mark.slow
def test_zeros_wrong_by_a_radian_are_found():
    offsets = np.random.default_rng(2).uniform(-1, 1, 7)
    true = built(62)
    true = replace(true, zeros_rad=true.zeros_rad + offsets)
    campaign = simulate(true, TABLES, 50, 2)
    result = identify(campaign, DESIGN_ARM, QUICK)
    assert result.converged
    assert result.global_test.passed
    # That of the first joint turns the arm as a whole: it is undetectable.
    assert result.zero_offsets_rad[1:6] == pytest.approx(offsets[1:6], abs=0.05)


@pytest.mark.slow
def test_a_far_start_survives_blunders():
    far = built(70, 10.0, np.radians(2.0))
    campaign, bad = with_blunders(simulate(far, TABLES, 60, 4), far, 0.05, 500.0)
    result = identify(campaign, DESIGN_ARM, QUICK)
    excluded = {entry.line - 2 for entry in result.excluded}
    assert len(excluded ^ bad) <= 3
    assert result.converged
    assert result.rms_before_mm > 20.0
    assert result.sigma0 < 1.2


@pytest.mark.parametrize(
    ("artefact", "n_spoilt"), [(0, 1), pytest.param(3, 2, marks=pytest.mark.slow)]
)
def test_a_joint_read_one_radian_off_costs_its_pose_alone(artefact, n_spoilt):
    """Decimetres off, at a seat or at one of the few touches of either sphere."""
    clean = simulate(built(1), TABLES, 27, 8)
    of_artefact = np.flatnonzero(clean.poses.artefacts == artefact)
    for bad in of_artefact[:n_spoilt]:
        angles_rad = clean.poses.angles_rad.copy()
        angles_rad[bad, 2] += 1.0
        poses = replace(clean.poses, angles_rad=angles_rad)
        result = identify(replace(clean, poses=poses), DESIGN_ARM, QUICK)
        assert [entry.line - 2 for entry in result.excluded] == [bad]
        assert result.converged
