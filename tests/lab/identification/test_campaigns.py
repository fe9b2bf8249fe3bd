"""Identification of campaigns made by the simulator's own physics."""

import numpy as np
import pytest
from scipy.stats import chi2

from benchmarks.proofs.conditions import mix_poses
from benchmarks.proofs.trials import PlantedNoise, distance_errors
from benchmarks.tools.handover import campaign_from_simulation
from traverse.lab.identification.identify import Options, identify
from traverse.simulator.campaigns import draw_noise
from traverse.simulator.campaigns.spec import NoiseTable

N_JOINTS = 7
DETERMINED = {
    "cones": 4 * N_JOINTS - 4,
    "cones+bar": 4 * N_JOINTS - 3,
    "bars": 4 * N_JOINTS - 3,
    "seats": 4 * N_JOINTS - 3,
    "wires": 4 * N_JOINTS - 3,
    "sphere-known": 4 * N_JOINTS - 3,
    "planes+length": 4 * N_JOINTS - 3,
    "points-own": 4 * N_JOINTS - 3,
    "points-arm": 4 * N_JOINTS + 3,
    "everything": 4 * N_JOINTS + 3,
}
QUICK = Options(n_suggestions=0)
# One in a thousand campaigns may be further out on either side.
RARE = 1e-3


# Those that differ most; `everything` has each kind of artefact.
IN_SHORT = ("cones", "cones+bar", "points-own", "everything")


@pytest.fixture(
    scope="module",
    params=[
        pytest.param(mix, marks=() if mix in IN_SHORT else pytest.mark.slow)
        for mix in DETERMINED
    ],
)
def mix(request):
    return request.param


@pytest.fixture(scope="module")
def poses(mix):
    return mix_poses(mix, 300, seed=5)


@pytest.fixture(scope="module")
def result(poses):
    campaign = campaign_from_simulation(draw_noise(poses, 11).campaign)
    return identify(campaign, poses.arm, QUICK)


def test_a_simulated_campaign_converges_to_the_noise_that_was_put_in(result):
    assert result.converged
    assert len(result.iterations) < 12
    assert result.rms_after_mm < 0.03 < result.rms_before_mm
    statistic = result.sigma0**2 * result.redundancy
    low, high = chi2.ppf([RARE, 1 - RARE], result.redundancy)
    assert low < statistic < high


def test_a_campaign_comes_out_as_foreseen_from_the_planted_errors(mix, poses):
    planted = PlantedNoise(poses, NoiseTable())
    options = Options(n_suggestions=0, snooping=False)
    simulated = draw_noise(poses, 13)
    result = identify(campaign_from_simulation(simulated.campaign), poses.arm, options)
    assert result.redundancy == planted.redundancy
    foreseen = planted.foreseen(simulated)
    total = result.adjustment.system.sum_of_squares
    spread = np.sqrt(2.0 * result.redundancy)
    assert abs(total - foreseen.sum_of_squares) < 0.1 * spread
    has_scale = mix != "cones"
    errors = distance_errors(
        result, poses, 4, has_scale=has_scale, steps=foreseen.steps
    )
    spread = np.sqrt(2.0 * errors.degrees)
    assert abs(errors.chi_square - errors.foreseen) < 0.1 * spread


def test_predicted_distances_are_as_wrong_as_the_covariance_says(mix, poses, result):
    errors = distance_errors(result, poses, 1, has_scale=mix != "cones")
    low, high = chi2.ppf([RARE, 1 - RARE], errors.degrees)
    # Points in the arm's system also determine its place, distances do not.
    assert errors.degrees == min(DETERMINED[mix], 4 * N_JOINTS - 3)
    assert low < errors.chi_square < high


def test_what_a_mix_determines_is_what_theory_says(mix, result):
    assert result.adjustment.split.n_determined == DETERMINED[mix]
    if mix == "cones":
        (scale,) = result.undetermined
        assert "no length" in scale.why
    else:
        assert result.undetermined == ()
