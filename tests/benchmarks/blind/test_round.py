from functools import cache

import numpy as np
import pytest

from benchmarks.blind.detectable_sizes import noise_free_campaign, ruler
from benchmarks.blind.hidden.effects import EFFECT_KINDS
from benchmarks.blind.hidden.poses import drawn, played, pose_set
from benchmarks.blind.round import Scenario, hide
from benchmarks.proofs.conditions import demo_arm
from traverse.lab.campaign.holdout import split
from traverse.lab.diagnosis.model.fit import fitted

POSE_SEED = 1


@cache
def measure(n_lengths=1):
    poses = pose_set(demo_arm(), POSE_SEED, n_lengths)
    choosing, _ = split(noise_free_campaign(poses), POSE_SEED)
    return ruler(poses, poses.arm, choosing)


def effects_of(kind, measure, count):
    rng = np.random.default_rng(7)
    effects = []
    while len(effects) < count:
        sized = measure.sized(drawn(rng, measure.poses, kind), 10.0)
        if sized is not None:
            effects.append(sized)
    return effects


@pytest.mark.parametrize("kind", EFFECT_KINDS)
def test_the_library_knows_what_the_simulator_plays(kind):
    # Two programs and two physics; steps are scanned and are in no library.
    of = measure(2 if kind == "artefact_length" else 1)
    (effect,) = effects_of(kind, of, 1)
    if kind in ("count_slip", "base_step"):
        assert of.likeness(effect) < 1.0
        return
    names = {name[0] for name in of.names_like(effect)}
    assert kind in names


@pytest.mark.parametrize("kind", ["encoder_scale", "axis_wobble", "base_drift"])
def test_a_size_is_what_a_fit_without_the_effect_leaves_over(kind):
    of = measure()
    (effect,) = effects_of(kind, of, 1)
    assert np.linalg.norm(of.signal((effect,))) == pytest.approx(10.0, rel=1e-4)
    campaign = noise_free_campaign(played(of.poses, (effect,)))
    choosing, _ = split(campaign, POSE_SEED)
    left = fitted(campaign, of.poses.arm, choosing).adjustment.system.sum_of_squares
    assert np.sqrt(left) == pytest.approx(10.0, rel=0.02)


def test_a_joint_without_gravity_torque_shows_no_compliance():
    of = measure()
    rng = np.random.default_rng(0)
    while True:
        effect = drawn(rng, of.poses, "joint_compliance")
        if effect.joint == "J1":
            break
    assert of.sized(effect, 10.0) is None


def test_mount_and_first_bearing_are_aliases():
    of = measure()
    (effect,) = effects_of("mount_compliance", of, 1)
    names = of.names_like(effect)
    assert ("bearing_compliance", "J1", None, None, None) in names


def test_equal_seeds_hide_equal_effects():
    scenario = Scenario("blind", 2, 8.0)
    first, second = (hide(demo_arm(), scenario, 4) for _ in range(2))
    assert first.hidden == second.hidden
    assert np.array_equal(
        first.campaign.poses.angles_rad, second.campaign.poses.angles_rad
    )


def test_blunders_come_upon_the_same_effect_and_noise():
    plain = hide(demo_arm(), Scenario("plain", 1, 8.0), 4)
    spoilt = hide(demo_arm(), Scenario("spoilt", 1, 8.0, blunder_share=0.05), 4)
    assert plain.hidden == spoilt.hidden
    apart = plain.campaign.poses.angles_rad - spoilt.campaign.poses.angles_rad
    n_spoilt = np.count_nonzero(np.any(np.abs(apart) > 1e-12, axis=1))
    assert n_spoilt == round(0.05 * len(apart))


def test_streams_have_noise_of_their_own():
    first = hide(demo_arm(), Scenario("a", stream=1), 4)
    second = hide(demo_arm(), Scenario("b", stream=2), 4)
    assert first.simulated.truth.encoder_noise_rad[0, 0] != pytest.approx(
        second.simulated.truth.encoder_noise_rad[0, 0]
    )


def test_what_is_outside_has_no_alias_in_the_library():
    case = hide(demo_arm(), Scenario("outside", 1, 10.0, outside=True), 2)
    assert case.truths[0].aliases == frozenset()
    assert not case.truths[0].in_library


def test_the_campaign_says_nothing_of_what_was_hidden():
    case = hide(demo_arm(), Scenario("one", 1, 10.0), 2)
    assert case.arm.effects == ()
    assert case.campaign.encoder_rad == pytest.approx(5e-6)


def test_wrong_noise_is_stated_too_small():
    case = hide(demo_arm(), Scenario("wrong", stated_factor=1.0 / 1.4), 2)
    assert case.campaign.encoder_rad == pytest.approx(5e-6 / 1.4)
