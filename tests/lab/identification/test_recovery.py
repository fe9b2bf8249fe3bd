"""The true values are recovered, within the stated covariance, whatever the datum."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from tests.lab.diagnosis.fitted_rows import measured
from tests.lab.simulated import (
    DESIGN,
    DESIGN_ARM,
    Noise,
    arm_value,
    bar,
    built,
    cones,
    in_another_posture,
    seven_joints,
    simulate,
)
from traverse.kinematics.model.derivatives import probe_derivatives
from traverse.kinematics.model.forward import probe_centre
from traverse.lab.adjustment.datum import rigid_motions, with_datum
from traverse.lab.identification.identify import Options, identify

PLAIN = Options(snooping=False, coarse_start=False, n_suggestions=0)
SPHERE = {"id": "ball", "kind": "sphere", "radius_mm": 25.4}
GAUGE = {"id": "gauge", "kind": "parallel_planes", "distance_mm": 100.0}
PLANES = [{"id": f"plane-{i}", "kind": "plane"} for i in range(2)]
NET = {
    "id": "net",
    "kind": "points",
    "frame": "own",
    "points_mm": {"A": [0.0, 0, 0], "B": [200.0, 0, 0], "C": [0.0, 150, 60]},
}
CONES_AND_BAR = [*cones(3), bar()]
EVERYTHING = [*cones(2), bar(), SPHERE, GAUGE, *PLANES, NET]


def distances(geometry, angles_rad):
    """Distances between all pairs of probe centres: no datum enters."""
    centres = probe_centre(geometry, angles_rad)
    first, second = np.triu_indices(len(centres), 1)
    return np.linalg.norm(centres[first] - centres[second], axis=1)


def distance_slopes(result, angles_rad):
    """Derivatives of those distances by the free parameters."""
    adjustment = result.adjustment
    values = adjustment.state.arm
    derivatives = probe_derivatives(values.geometry, angles_rad)
    poses = adjustment.network.campaign.poses.part(np.arange(len(angles_rad)))
    columns = adjustment.network.parameters.columns(values, derivatives, poses)
    first, second = np.triu_indices(len(angles_rad), 1)
    along = derivatives.centres_mm[first] - derivatives.centres_mm[second]
    units = along / np.linalg.norm(along, axis=1, keepdims=True)
    return np.einsum("ni,nip->np", units, columns[first] - columns[second])


def squared_deviation(result, true, n_postures=12):
    """Chi-square of predicted distances against the truth, and its degrees."""
    angles = np.random.default_rng(99).uniform(-3, 3, (n_postures, 7))
    slopes = distance_slopes(result, angles)
    error = distances(result.adjustment.state.arm.geometry, angles) - distances(
        true.geometry(), angles
    )
    covariance = slopes @ result.covariance @ slopes.T
    values, vectors = np.linalg.eigh(covariance)
    good = values > 1e-9 * values.max()
    return float(np.sum((vectors[:, good].T @ error) ** 2 / values[good])), good.sum()


def test_a_single_campaign_is_as_good_as_it_says():
    true = built(7)
    campaign = simulate(true, EVERYTHING, 40, 7)
    result = identify(campaign, DESIGN_ARM, PLAIN)
    statistic, degrees = squared_deviation(result, true)
    assert chi2.ppf(0.001, degrees) < statistic < chi2.ppf(0.999, degrees)
    assert result.rms_after_mm < 0.01
    assert result.rms_before_mm > 1.0
    assert result.global_test.passed


def test_without_noise_the_truth_is_recovered_exactly():
    true = built(8)
    exact = simulate(true, EVERYTHING, 25, 8, noise=Noise(0.0, 0.0))
    result = identify(exact, DESIGN_ARM, PLAIN)
    angles = np.random.default_rng(1).uniform(-3, 3, (10, 7))
    distances_mm = distances(result.adjustment.state.arm.geometry, angles)
    assert distances_mm == pytest.approx(distances(true.geometry(), angles), abs=1e-6)


def test_points_in_the_arms_system_give_absolute_positions():
    true = replace(built(9), origin_mm=np.array([13.0, -22.0, 31.0]))
    points = {"A": [600.0, 0, 300], "B": [-200.0, 500, 500], "C": [300.0, -500, 100]}
    table = {"id": "net", "kind": "points", "frame": "arm", "points_mm": points}
    campaign = simulate(true, [table], 150, 9)
    result = identify(campaign, DESIGN_ARM, PLAIN)
    angles = np.random.default_rng(1).uniform(-3, 3, (20, 7))
    centres_mm = probe_centre(result.adjustment.state.arm.geometry, angles)
    assert centres_mm == pytest.approx(true.centres(angles), abs=0.05)


def test_the_answer_does_not_depend_on_the_datum():
    campaign = simulate(built(4), CONES_AND_BAR, 40, 4)
    angles = np.random.default_rng(1).uniform(-3, 3, (10, 7))
    first = identify(campaign, DESIGN_ARM, PLAIN)
    used = first.adjustment.network.parameters
    moved = np.array(
        [
            used.free[index] or name.startswith(("origin", "probe")) or ".zero" in name
            for index, name in enumerate(used.names)
        ]
    )
    joints = np.array([".axis." in n or ".link." in n for n in used.names])
    freed = used.with_free(used.free | joints)
    changed = with_datum(freed, DESIGN.geometry(), preferred=moved)
    hold = tuple(np.array(used.names)[joints & ~changed.free])
    assert len(hold) == 3
    assert not set(hold) & set(np.array(used.names)[~used.free])
    second = identify(campaign, DESIGN_ARM, replace(PLAIN, hold=hold))
    assert second.adjustment.network.parameters.n_free == 25
    first_geometry, second_geometry = (
        r.adjustment.state.arm.geometry for r in (first, second)
    )
    assert distances(first_geometry, angles) == pytest.approx(
        distances(second_geometry, angles), abs=1e-9
    )
    assert first.sigma0 == pytest.approx(second.sigma0, rel=1e-9)


def test_the_answer_does_not_depend_on_the_base_posture():
    campaign = simulate(built(5), CONES_AND_BAR, 40, 5)
    angles = np.random.default_rng(1).uniform(-3, 3, (10, 7))
    turns = np.random.default_rng(2).uniform(-2, 2, 7)
    moved = in_another_posture(DESIGN, turns)
    assert moved.centres(angles) == pytest.approx(DESIGN.centres(angles), abs=1e-10)
    distances_mm = [
        distances(
            identify(campaign, arm_value(arm), PLAIN).adjustment.state.arm.geometry,
            angles,
        )
        for arm in (DESIGN, moved)
    ]
    assert distances_mm[0] == pytest.approx(distances_mm[1], rel=0, abs=1e-9)


def test_rigid_motions_change_no_distance():
    campaign = simulate(DESIGN, cones(1), 20, 1)
    result = identify(campaign, DESIGN_ARM, PLAIN)
    parameters = result.adjustment.network.parameters
    all_free = parameters.with_free(np.ones_like(parameters.free))
    values = result.adjustment.state.arm
    derivatives = probe_derivatives(values.geometry, campaign.poses.angles_rad)
    columns = all_free.columns(values, derivatives, campaign.poses)
    moved = columns @ rigid_motions(all_free, values.geometry)
    centred = derivatives.centres_mm - values.geometry.origin_mm
    for turn, unit in enumerate(np.eye(3)):
        shift = moved[:, :, turn] - np.cross(unit, centred)
        assert np.allclose(shift - shift[0], 0.0, atol=1e-9)
        assert np.allclose(moved[:, :, 3 + turn], unit, atol=1e-12)


def test_the_datum_holds_three_components_and_the_origin():
    geometry = seven_joints().geometry()
    campaign = simulate(DESIGN, cones(1), 5, 1)
    result = identify(campaign, DESIGN_ARM, PLAIN)
    parameters = result.adjustment.network.parameters
    held = set(parameters.names) - set(parameters.free_names)
    joints = {name for name in held if ".axis." in name or ".link." in name}
    assert len(joints) == 3
    assert with_datum(parameters, geometry).n_free == parameters.n_free


def test_the_campaigns_poses_are_left_alone():
    campaign = simulate(built(4), EVERYTHING, 10, 4)
    campaign.poses.angles_rad.setflags(write=False)
    before = campaign.poses.angles_rad.copy()
    identify(campaign, DESIGN_ARM)
    assert np.array_equal(before, campaign.poses.angles_rad)


@pytest.mark.parametrize("seed", [112, 118, 135])
def test_a_ball_is_not_taken_for_its_mirror_image(seed):
    """Three or four touches lie on two balls of one radius.

    The arm as given is a millimetre off and chooses the wrong one: what came of these
    seeds was a right certificate accused by 6 sigma, or 45 times the noise.
    """
    campaign = measured(seed).campaign
    short = campaign.part(np.arange(len(campaign.poses)) < 48)
    result = identify(short, DESIGN_ARM, Options(n_suggestions=0))
    assert result.sigma0 < 1.3
    assert result.contradictions == ()
