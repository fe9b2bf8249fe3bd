"""Hinges that another joint's drive turns: from the arm file to the identified arm."""

import pytest
from scipy.stats import chi2

from benchmarks.proofs.conditions import demo_arm, mix_poses
from benchmarks.proofs.trials import distance_errors
from benchmarks.tools.handover import campaign_from_simulation
from tests.simulator.campaigns.arms import coupled
from traverse.kinematics.arm_file.arm import effect_from_table
from traverse.lab.identification.identify import Options, identify
from traverse.simulator.campaigns import draw_noise

ARM = coupled(demo_arm(), J3=("J2", -1.0), J5=("J4", 0.4))
QUICK = Options(n_suggestions=0)
WAVE = {"kind": "encoder_eccentricity", "cos_rad": 3e-4, "sin_rad": -2e-4}


@pytest.fixture(scope="module", params=["rigid", "J2", "J5"])
def arm(request):
    """The arm, also with errors of the encoder that leads and of one that is led."""
    effects = [effect_from_table({**WAVE, "joint": request.param})]
    return ARM.model_copy(
        update={"effects": tuple(effects[: request.param != "rigid"])}
    )


@pytest.fixture(scope="module")
def poses(arm):
    return mix_poses("cones+bar", 200, seed=5, arm=arm)


def test_a_coupled_arm_is_identified_to_its_noise(arm, poses):
    result = identify(
        campaign_from_simulation(draw_noise(poses, 11).campaign), arm, QUICK
    )
    assert result.converged
    low, high = chi2.ppf([1e-3, 1 - 1e-3], result.redundancy)
    assert low < result.sigma0**2 * result.redundancy < high
    errors = distance_errors(result, poses, 1)
    low, high = chi2.ppf([1e-3, 1 - 1e-3], errors.degrees)
    assert low < errors.chi_square < high
