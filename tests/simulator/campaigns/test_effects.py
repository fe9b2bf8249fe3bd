import json

import numpy as np
import pytest

from tests.shared import shared
from tests.simulator.campaigns.arms import seven_joint_arm
from tests.simulator.effects.examples import example, heavy_arm, spec_of
from traverse.kinematics.arm_file.arm import read_arm
from traverse.simulator.campaigns import (
    BallBar,
    CampaignSpec,
    Cone,
    NoiseTable,
    Points,
    draw_noise,
    make_poses,
    with_effects,
    write_campaign,
)
from traverse.simulator.effects import MissedContactError, Sawtooth
from traverse.strict_toml.problems import FileError

ARM = heavy_arm()
SPEC = spec_of(
    Cone(id="cone", n_poses=12),
    BallBar(id="bar", n_poses=12, radius_mm=12.7, distance_mm=400.0),
    Points(id="grid", n_poses=8, n_points=4, size_mm=150.0, frame="own"),
)


@shared
def rigid():
    return make_poses(ARM, SPEC, seed=3)


QUIET = NoiseTable(encoder_rad=0.0, contact_mm=0.0, direction_rad=0.0)


def tables(simulated) -> dict:
    return {a.id: a.table for a in simulated.campaign.artefacts}


def test_readings_of_a_quiet_campaign_are_those_of_the_poses():
    poses = with_effects(rigid(), [example("backlash"), example("thermal_expansion")])
    drawn = draw_noise(poses, 1, QUIET)
    np.testing.assert_array_equal(drawn.campaign.readings_rad, poses.readings_rad)
    np.testing.assert_array_equal(drawn.truth.contacts_mm, rigid().contacts_mm)
    assert drawn.truth.effects == poses.effects


def test_noise_is_the_same_with_and_without_effects():
    poses = with_effects(rigid(), [example("encoder_eccentricity")])
    with_effect, without = draw_noise(poses, 5), draw_noise(rigid(), 5)
    changed_rad = with_effect.campaign.readings_rad - without.campaign.readings_rad
    effect_rad = poses.readings_rad - rigid().readings_rad
    np.testing.assert_allclose(changed_rad, effect_rad, rtol=0, atol=1e-7)
    assert np.max(np.abs(effect_rad)) > 1e-4


def test_a_standard_is_longer_than_its_certificate_says():
    effects = [
        example("artefact_length"),
        example("artefact_length", artefact="grid", error_ppm=-50.0),
    ]
    certified = tables(draw_noise(with_effects(rigid(), effects), 1, QUIET))
    true = tables(draw_noise(rigid(), 1, QUIET))
    assert certified["bar"]["distance_mm"] == pytest.approx(
        400.0 / (1.0 + 80e-6), abs=1e-12
    )
    assert certified["bar"]["radius_mm"] == 12.7
    for name, at_mm in true["grid"]["points_mm"].items():
        shrunk_mm = np.array(certified["grid"]["points_mm"][name]) * (1.0 - 50e-6)
        np.testing.assert_allclose(shrunk_mm, at_mm, rtol=0, atol=1e-12)


def test_temperature_rises_by_the_drift():
    conditions = SPEC.conditions.model_copy(update={"swing_c": 0.0, "drift_c": 3.0})
    spec = SPEC.model_copy(update={"conditions": conditions})
    drawn = make_poses(ARM, spec, seed=3).around
    share = drawn.time_s / drawn.time_s[-1]
    expected_c = 20.0 + 3.0 * (share - 0.5)
    np.testing.assert_allclose(drawn.temperature_c, expected_c, rtol=0, atol=1e-12)


def test_effects_bound_to_time_need_a_start():
    untimed = rigid().spec.conditions.model_copy(update={"start_utc": None})
    spec = rigid().spec.model_copy(update={"conditions": untimed})
    poses = make_poses(ARM, spec, seed=3)
    effects = [example("base_drift"), example("count_slip"), example("backlash")]
    with pytest.raises(FileError, match="base_drift, count_slip count from") as caught:
        with_effects(poses, effects)
    assert [p.where for p in caught.value.problems] == ["conditions.start_utc"]


def test_effects_that_cannot_be_played_are_refused_all_at_once():
    poses = make_poses(seven_joint_arm(), SPEC, seed=3)
    effects = [
        example("joint_compliance"),
        example("backlash", joint="J9"),
        example("empirical", covariate="humidity"),
    ]
    with pytest.raises(FileError) as caught:
        with_effects(poses, effects)
    where = [problem.where for problem in caught.value.problems]
    assert where == ["effects[0]", "effects[1].joint", "effects[2].covariate"]


def test_effects_that_are_not_small_are_refused():
    with pytest.raises(MissedContactError, match="mm off a contact"):
        with_effects(rigid(), [example("thermal_expansion", expansion_per_c=0.4)])


def test_the_folder_hides_effects_in_the_truth(tmp_path):
    arm = ARM.model_copy(update={"effects": (example("axis_wobble"),)})
    teeth = Sawtooth(slice(0, 1), 4, 1e-5)
    poses = make_poses(arm, SPEC, seed=3)
    poses = with_effects(poses, poses.effects, [teeth])
    write_campaign(tmp_path, draw_noise(poses, 1), arm)
    assert read_arm(tmp_path / "arm.toml").effects == ()
    (wobble,) = read_arm(tmp_path / "truth" / "arm.toml").effects
    assert wobble == poses.effects[0]
    axis = poses.truth.mechanism.axes[2]
    assert abs(np.array(wobble.values["cos_rad"]) @ axis) < 1e-18
    (fault,) = json.loads((tmp_path / "truth" / "truth.json").read_text())["faults"]
    assert fault.startswith("Sawtooth(")
    assert "teeth=4" in fault


def test_a_specification_may_have_a_mix_and_an_arm_with_effects():
    arm = ARM.model_copy(update={"effects": (example("probe_radius"),)})
    spec = CampaignSpec(mix="cones+bar", n_poses=40)
    poses = make_poses(arm, spec, seed=1)
    balls_mm = poses.faulty.balls_mm(poses.turns_rad, poses.around)
    np.testing.assert_allclose(balls_mm, poses.contacts_mm, rtol=0, atol=1e-9)
