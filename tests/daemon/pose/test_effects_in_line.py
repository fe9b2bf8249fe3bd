"""Each effect of the arm file reaches the poses, with what it needs.

Effects that need the stream do not depend on its division into blocks.

What the effects compute is proved with `traverse.kinematics.effects`; here the formulas
of the arm file's table are done by hand, on readings that the test itself makes.
"""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.daemon.effect_entries import (
    CONTACTS,
    FIRST_UTC,
    IDENTIFIED,
    MASSES,
    OF_POSTURE,
    READINGS,
    TEMPERATURE_C,
    N,
    counts_of,
    effect,
    everything,
)
from tests.daemon.pose.test_pipeline import ZEROS, probe_by_hand
from tests.daemon.values import (
    ARM,
    SetClock,
    arm_model,
    count_samples,
    joined_poses,
    latch,
)
from traverse.daemon.pose.pipeline import Pipeline
from traverse.kinematics.effect_table import EFFECT_KINDS
from traverse.kinematics.effects.base.block import Block
from traverse.kinematics.effects.pose import corrected_pose
from traverse.protocol.messages import Quality


def posed(folder, *effects, temperature_c=TEMPERATURE_C, before=""):
    model = arm_model(folder, MASSES + before + "".join(effects))
    pipeline = Pipeline(model, SetClock())
    return pipeline.poses(count_samples(counts_of()), temperature_c)


def flags(poses, row=-1):
    return Quality.from_bits(int(poses.quality[row])).flags


def with_readings_off(poses, joint, d_alpha):
    """Places and shanks by matrices where one reading, or all, is wrong by this."""
    readings = poses.angles_rad.copy()
    readings[:, joint] -= d_alpha
    probes = [probe_by_hand(row) for row in readings]
    return np.array([place for place, _ in probes]), np.array(
        [ijk for _, ijk in probes]
    )


@pytest.mark.parametrize("kind", READINGS)
def test_corrections_of_a_reading_get_what_they_need(tmp_path, kind):
    keys, d_alpha = READINGS[kind]
    poses = posed(tmp_path, effect(kind, joint='"J2"', **keys), before=IDENTIFIED)
    off = d_alpha(poses.angles_rad[:, 1], np.arange(N) * 0.01)
    assert np.ptp(off) > 1e-4 or (off > 1e-4).all()  # else it would show nothing
    xyz_mm, ijk = with_readings_off(poses, 1, off)
    assert np.allclose(poses.xyz_mm, xyz_mm, atol=1e-6)
    assert np.allclose(poses.ijk, ijk, atol=1e-9)


def test_a_coupled_hinge_turns_with_the_corrected_reading_of_the_other(tmp_path):
    keys, d_alpha = READINGS["encoder_scale"]
    text = MASSES + IDENTIFIED + effect("encoder_scale", joint='"J2"', **keys)
    joint = 'name = "J3"\n'
    assert text.count(joint) == 1
    text = text.replace(joint, f'{joint}coupled_to = "J2"\nratio = -0.5\n')
    pipeline = Pipeline(arm_model(tmp_path, text), SetClock())
    poses = pipeline.poses(count_samples(counts_of()), TEMPERATURE_C)
    hinges = poses.angles_rad.copy()
    hinges[:, 1] -= d_alpha(poses.angles_rad[:, 1], np.arange(N) * 0.01)
    hinges[:, 2] -= 0.5 * (hinges[:, 1] - ZEROS[1])
    xyz_mm = [probe_by_hand(row)[0] for row in hinges]
    assert np.allclose(poses.xyz_mm, xyz_mm, atol=1e-6)


def test_latency_of_no_joint_is_that_of_all(tmp_path):
    poses = posed(tmp_path, effect("encoder_latency", latency_s=2e-3))
    speeds = np.diff(poses.angles_rad, axis=0, prepend=poses.angles_rad[:1]) / 0.01
    xyz_mm, _ = with_readings_off(poses, slice(None), -2e-3 * speeds)
    assert np.allclose(poses.xyz_mm, xyz_mm, atol=1e-6)


def test_a_curve_follows_its_covariate_and_is_flagged_everywhere(tmp_path):
    curve = {
        "joint": '"J2"',
        "knots": [20.0, 25.0, 30.0],
        "values_rad": [0.0, 5e-4, 10e-4],  # a straight line
    }
    curve["covariate"] = '"temperature_c"'
    poses = posed(tmp_path, effect("empirical", **curve))
    xyz_mm, _ = with_readings_off(poses, 1, 7.5e-4)
    assert np.allclose(poses.xyz_mm, xyz_mm, atol=1e-6)
    assert Quality.from_bits(int(poses.quality[0])) == Quality(
        ok=True, flags=("empirical",)
    )
    hot = posed(tmp_path, effect("empirical", **curve), temperature_c=31.0)
    assert flags(hot) == ("empirical", "beyond_knots")
    assert not Quality.from_bits(int(hot.quality[0])).ok


def test_elements_grow_with_the_temperature(tmp_path):
    plain = posed(tmp_path)
    warm = posed(tmp_path, effect("thermal_expansion", expansion_per_c=2e-5))
    # All elements by 2e-5 x 7.5 C, the probe's 50 mm not, and nothing turns.
    probe_mm = 50.0 * plain.ijk
    origin_mm = np.array([1.0, -2.0, 3.5])
    grown_mm = origin_mm + (plain.xyz_mm - probe_mm - origin_mm) * (1 + 1.5e-4)
    assert np.allclose(warm.xyz_mm, grown_mm + probe_mm, atol=1e-9)
    assert np.allclose(warm.ijk, plain.ijk, atol=1e-12)


def test_the_base_moves_with_the_time_in_utc(tmp_path):
    plain = posed(tmp_path)
    step = effect("base_step", at_s=0.25, step_mm=[1.0, 2.0, 3.0], epoch_utc=FIRST_UTC)
    stepped = posed(tmp_path, step)
    by_hand = np.outer(np.arange(N) > 24, [1.0, 2.0, 3.0])
    assert np.allclose(stepped.xyz_mm - plain.xyz_mm, by_hand, atol=1e-9)
    assert not stepped.quality.any()
    drift = effect("base_drift", rate_mm_s=[0.0, 0.0, 10.0], epoch_utc=FIRST_UTC)
    drifted = posed(tmp_path, drift, before=IDENTIFIED)
    seconds = np.minimum(np.arange(N) * 0.01, 0.3)
    by_hand = np.outer(seconds, [0.0, 0.0, 10.0])
    assert np.allclose(drifted.xyz_mm - plain.xyz_mm, by_hand, atol=1e-6)
    stale = [flags(drifted, row) == ("stale_effect",) for row in range(N)]
    assert stale == [False] * 31 + [True] * 29
    assert not Quality.from_bits(int(drifted.quality[-1])).ok


@pytest.mark.parametrize("kind", OF_POSTURE)
def test_corrections_of_the_posture_are_applied(tmp_path, kind):
    poses = posed(tmp_path, effect(kind, **OF_POSTURE[kind]))
    model = arm_model(tmp_path, MASSES + effect(kind, **OF_POSTURE[kind]))
    xyz_mm, ijk, _ = corrected_pose(
        model.geometry, model.effects, Block(angles_rad=poses.angles_rad)
    )
    assert poses.xyz_mm.tobytes() == xyz_mm.tobytes()
    assert poses.ijk.tobytes() == ijk.tobytes()
    assert np.abs(poses.xyz_mm - posed(tmp_path).xyz_mm).max() > 0.005
    assert not poses.quality.any()


@pytest.mark.parametrize("kind", CONTACTS)
def test_what_needs_the_surface_is_left_out_and_flagged(tmp_path, kind):
    poses = posed(tmp_path, effect(kind, **CONTACTS[kind]))
    assert np.allclose(poses.xyz_mm, posed(tmp_path).xyz_mm, atol=1e-9)
    assert {flags(poses, row) for row in range(N)} == {("surface_unknown",)}
    assert not Quality.from_bits(int(poses.quality[0])).ok


def test_what_is_off_line_only_changes_no_bit(tmp_path):
    plain = posed(tmp_path)
    poses = posed(tmp_path, effect("artefact_length", artefact='"bar"', error_ppm=9.0))
    assert poses.xyz_mm.tobytes() == plain.xyz_mm.tobytes()
    assert not poses.quality.any()


def test_first_moments_serve_where_no_mass_is_known(tmp_path):
    """Those of the masses, which are not stated: the same place."""
    soft = effect("joint_compliance", joint='"J2"', compliance_rad_nm=1e-4)
    weighed = arm_model(tmp_path, MASSES + soft)
    levers_kg_m = 1e-3 * weighed.effects.levers_kg_mm(weighed.geometry)
    moments = [
        effect("first_moment", joint=f'"{joint.name}"', moment_kg_m=lever)
        for joint, lever in zip(weighed.arm.joints, levers_kg_m.tolist(), strict=True)
    ]
    model = arm_model(tmp_path, "".join([ARM, soft, *moments]))
    assert all(joint.mass_kg is None for joint in model.arm.joints)
    samples = count_samples(counts_of())
    poses = Pipeline(model, SetClock()).poses(samples, TEMPERATURE_C)
    wanted = posed(tmp_path, soft)
    assert np.allclose(poses.xyz_mm, wanted.xyz_mm, atol=1e-9)
    assert np.abs(poses.xyz_mm - posed(tmp_path).xyz_mm).max() > 0.005
    assert not poses.quality.any()


def test_every_kind_of_the_arm_file_is_tested_here():
    here = {"thermal_expansion", "base_step", "base_drift", "empirical"}
    here |= {*READINGS, *OF_POSTURE, *CONTACTS, "artefact_length", "first_moment"}
    assert here == set(EFFECT_KINDS)


@pytest.mark.parametrize(
    "entry",
    [
        effect("encoder_temperature", joint='"J2"', rate_rad_c=1e-4),
        effect("thermal_expansion", expansion_per_c=2e-5),
    ],
)
def test_without_a_temperature_the_reference_is_taken_and_flagged(tmp_path, entry):
    poses = posed(tmp_path, entry, temperature_c=None)
    assert np.allclose(poses.xyz_mm, posed(tmp_path).xyz_mm, atol=1e-9)
    assert {flags(poses, row) for row in range(N)} == {("temperature_unknown",)}
    assert not Quality.from_bits(int(poses.quality[0])).ok
    assert not posed(tmp_path, entry).quality.any()


def test_before_any_motion_it_is_unknown_and_flagged(tmp_path):
    latency = posed(tmp_path, effect("encoder_latency", latency_s=2e-3))
    assert [flags(latency, row) for row in (0, 1)] == [("motion_unknown",), ()]
    backlash = arm_model(
        tmp_path, MASSES + effect("backlash", joint='"J2"', half_width_rad=4e-4)
    )
    still = counts_of()
    still[:9, 0] = still[0, 0]  # joint 2 rests, the others move
    pipeline = Pipeline(backlash, SetClock())
    poses = pipeline.poses(count_samples(still))
    assert [bool(bits) for bits in poses.quality] == [True] * 9 + [False] * (N - 9)


@pytest.fixture(scope="module")
def full_model(tmp_path_factory):
    return arm_model(tmp_path_factory.mktemp("arm"), MASSES + IDENTIFIED + everything())


@given(st.lists(st.integers(1, N - 1), max_size=6), st.integers(0, 1000))
@settings(max_examples=40)
def test_cutting_a_stream_into_blocks_changes_no_bit(full_model, cuts, seed):
    counts = counts_of(seed)
    samples = count_samples(counts)
    whole = Pipeline(full_model, SetClock()).poses(samples, TEMPERATURE_C)
    pipeline = Pipeline(full_model, SetClock())
    parts = [
        pipeline.poses(count_samples(counts[a:b], first=a), TEMPERATURE_C)
        for a, b in pairwise(sorted({0, *cuts, N}))
    ]
    joined = joined_poses(parts)
    for name in ("angles_rad", "xyz_mm", "ijk", "quality"):
        assert getattr(joined, name).tobytes() == getattr(whole, name).tobytes()


@pytest.mark.parametrize("row", [1, 30, N - 1])
@pytest.mark.parametrize("late", [0, 1])
def test_a_latch_is_corrected_like_a_sample_of_its_time(full_model, row, late):
    counts = counts_of()
    whole = Pipeline(full_model, SetClock()).poses(count_samples(counts), TEMPERATURE_C)
    pipeline = Pipeline(full_model, SetClock())
    pipeline.poses(count_samples(counts[: row + late]), TEMPERATURE_C)
    time_ns = int(whole.sample_time_ns[row])
    edge = latch(tuple(counts[row].tolist()), now_ns=time_ns + 400_000)
    assert edge.sample_time_ns == time_ns
    pose = pipeline.latched_pose(edge, TEMPERATURE_C)
    assert pose.xyz_mm.tobytes() == whole.xyz_mm[row].tobytes()
    assert pose.ijk.tobytes() == whole.ijk[row].tobytes()
    assert pose.quality == whole.quality[row]


def test_a_restart_forgets_the_motion_and_a_new_model_replaces_all_effects(tmp_path):
    model = arm_model(tmp_path, MASSES + effect("encoder_latency", latency_s=2e-3))
    pipeline = Pipeline(model, SetClock())
    counts = counts_of()
    pipeline.poses(count_samples(counts[:20]))
    pipeline.restart("base")
    after = pipeline.poses(count_samples(counts[20:40], first=20))
    assert [flags(after, row) for row in (0, 1)] == [("motion_unknown",), ()]
    grown = arm_model(tmp_path, MASSES + effect("thermal_expansion", expansion_per_c=1))
    pipeline.use_model(grown)
    poses = pipeline.poses(count_samples(counts[40:], first=40), 21.0)
    after_restart = Pipeline(grown, SetClock()).poses(
        count_samples(counts[40:], first=40), 21.0
    )
    assert poses.xyz_mm.tobytes() == after_restart.xyz_mm.tobytes()
    assert not poses.quality.any()
    place, _ = probe_by_hand(poses.angles_rad[-1])
    assert math.dist(poses.xyz_mm[-1], place) > 100.0
