from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.kinematics.effects.reference import NAMES, effect, random_readings
from tests.kinematics.effects.samples import (
    ARM,
    CAMPAIGN,
    EVERY_KIND,
    GEOMETRY,
    full_block,
)
from traverse.kinematics.arm_file.arm import effect_from_table
from traverse.kinematics.effect_table import EFFECT_KINDS
from traverse.kinematics.effects import effect_class
from traverse.kinematics.effects.arm_effects import effects_from_arm, effects_of
from traverse.kinematics.effects.base.block import Block, Covariate, Need
from traverse.kinematics.effects.columns import columns
from traverse.kinematics.effects.pose import corrected_pose
from traverse.kinematics.model.forward import probe_pose

ALL = effects_of(ARM, EVERY_KIND, CAMPAIGN)


def joined(parts):
    """Bytes of centres, directions and flags, part after part."""
    centres = np.concatenate([part[0] for part in parts])
    shanks = np.concatenate([part[1] for part in parts])
    flags = [
        np.concatenate([getattr(part[2], name) for part in parts])
        for name in ("stale_effect", "surface_unknown", "empirical", "beyond_knots")
    ]
    return b"".join(array.tobytes() for array in (centres, shanks, *flags))


@settings(max_examples=30)
@given(st.lists(st.integers(0, 1300), max_size=6))
def test_cutting_a_stream_with_all_effects_keeps_every_bit(cuts):
    block = full_block(seed=3, n_samples=1300)
    edges = [0, *sorted(cuts), 1300]
    parts = [
        corrected_pose(GEOMETRY, ALL, block.part(slice(start, end)))
        for start, end in pairwise(edges)
    ]
    assert joined(parts) == joined([corrected_pose(GEOMETRY, ALL, block)])


def test_each_sample_alone_has_the_bits_of_its_block():
    block = full_block(seed=4, n_samples=41)
    parts = [block.part(slice(n, n + 1)) for n in range(41)]
    undivided = corrected_pose(GEOMETRY, ALL, block)
    assert joined([corrected_pose(GEOMETRY, ALL, p) for p in parts]) == joined(
        [undivided]
    )
    moves = columns(GEOMETRY, ALL, block)
    one_by_one = [columns(GEOMETRY, ALL, p) for p in parts]
    assert np.concatenate(one_by_one).tobytes() == moves.tobytes()


def test_arm_without_effects_has_the_bits_of_the_plain_pose():
    readings = random_readings(5, n_samples=700)
    centres, shanks, flags = corrected_pose(
        GEOMETRY, effects_from_arm(ARM), Block(readings)
    )
    plain_centres, plain_shanks = probe_pose(GEOMETRY, readings)
    assert centres.tobytes() == plain_centres.tobytes()
    assert shanks.tobytes() == plain_shanks.tobytes()
    assert not (flags.stale_effect | flags.surface_unknown | flags.empirical).any()


def test_effects_of_no_size_have_the_plain_pose_but_for_the_last_digits():
    block = full_block(seed=6, n_samples=50)
    silent = ALL.with_values(np.zeros(len(ALL.values)))
    centres, _, _ = corrected_pose(GEOMETRY, silent, block)
    plain = probe_pose(GEOMETRY, block.angles_rad)[0]
    np.testing.assert_allclose(centres, plain, rtol=0, atol=1e-11)


def test_empty_block_gives_empty_results():
    centres, shanks, flags = corrected_pose(GEOMETRY, ALL, full_block(1, n_samples=0))
    assert centres.shape == shanks.shape == (0, 3)
    assert len(flags.stale_effect) == 0


def test_block_is_left_as_it_is():
    block = full_block(seed=8, n_samples=5)
    before = block.angles_rad.copy()
    for name in ("angles_rad", "speeds_rad_s", "directions", "joint_temperatures_c"):
        getattr(block, name).setflags(write=False)
    corrected_pose(GEOMETRY, ALL, block)
    columns(GEOMETRY, ALL, block)
    np.testing.assert_array_equal(block.angles_rad, before)


def test_every_kind_of_the_arm_file_can_be_built():
    assert all(effect_class(kind).kind == kind for kind in EFFECT_KINDS)


def test_all_that_is_missing_is_reported_at_once():
    with pytest.raises(ValueError, match="cannot be applied") as caught:
        corrected_pose(GEOMETRY, ALL, Block(random_readings(1)))
    problems = str(caught.value).splitlines()[1:]
    assert problems[0] == (
        "J4.encoder_temperature needs the temperature of J4: the block has no "
        "temperature"
    )
    assert "J2.backlash needs the direction of approach of J2" in str(caught.value)
    assert "base_drift needs the time in UTC: the block has no time" in str(
        caught.value
    )
    assert "thermal_expansion needs the temperature of J1" in str(caught.value)
    assert "J2.encoder_latency needs the speed of J2" in str(caught.value)


def test_single_unknown_value_is_reported_with_its_place():
    block = full_block(seed=2, n_samples=20)
    approaches = block.approaches.copy()
    approaches[[7, 9], 1] = np.nan
    approaches[3, 0] = np.nan  # that of J1 is not used
    with pytest.raises(
        ValueError, match="unknown in 2 of 20 samples, the first is num"
    ):
        corrected_pose(GEOMETRY, ALL, replace(block, approaches=approaches))


def test_joint_without_own_temperature_takes_that_of_the_arm_or_is_reported():
    correction = effects_of(
        ARM, (effect("encoder_temperature", joint="J2", rate_rad_c=1e-6),)
    )
    joint_c = np.full((4, 6), np.nan)
    block = Block(random_readings(1), joint_temperatures_c=joint_c)
    with pytest.raises(ValueError, match="temperature is unknown in 4 of 4"):
        corrected_pose(GEOMETRY, correction, block)
    corrected_pose(GEOMETRY, correction, replace(block, temperature_c=np.full(4, 22.0)))


def test_needs_say_what_a_daemon_must_supply():
    ones = (
        effect("backlash", joint="J2", half_width_rad=1e-5),
        effect("encoder_temperature", joint="J4", rate_rad_c=3e-6),
        effect("encoder_scale", joint="J4", scale_ppm=3.0),
    )
    assert effects_of(ARM, ones).needs == {
        Need(Covariate.APPROACH, 1),
        Need(Covariate.TEMPERATURE, 3),
    }


def test_compliance_without_any_weight_beyond_is_refused_with_all_others():
    weightless = tuple(
        joint.model_copy(update={"mass_kg": None}) if name in {"J5", "J6"} else joint
        for name, joint in zip(NAMES, ARM.joints, strict=True)
    )
    probe = ARM.probe.model_copy(update={"mass_kg": None})
    arm = ARM.model_copy(update={"joints": weightless, "probe": probe})
    ones = (
        effect("joint_compliance", joint="J5", compliance_rad_nm=1e-6),
        effect("joint_compliance", joint="J4", compliance_rad_nm=1e-6),
        effect(
            "empirical",
            joint="J1",
            covariate="J9_rad",
            knots=[0.0, 1.0],
            values_rad=[0.0, 0.0],
        ),
    )
    with pytest.raises(ValueError, match="no mass_kg for J5, J6 nor for the") as caught:
        effects_of(arm, ones)
    assert "effects[1]" not in str(caught.value)
    assert "effects[2]: empirical: covariate 'J9_rad' is none" in str(caught.value)


def test_effect_of_a_joint_that_the_arm_lacks_is_refused():
    correction = effect("backlash", joint="J8", half_width_rad=1e-5)
    with pytest.raises(ValueError, match="names joint 'J8', which this arm does not"):
        effects_of(ARM, (correction,))


def test_block_of_another_arm_is_refused():
    with pytest.raises(ValueError, match="block has 5 joints, the geometry 6"):
        corrected_pose(GEOMETRY, ALL, Block(np.zeros((2, 5))))


@pytest.mark.parametrize(
    ("name", "shape"),
    [("temperature_c", (3,)), ("approaches", (2, 5)), ("gravity_m_s2", (2, 3))],
)
def test_column_of_another_shape_is_refused(name, shape):
    with pytest.raises(ValueError, match=f"block: {name} has shape"):
        Block(np.zeros((2, 6)), **{name: np.zeros(shape)})


def test_values_go_back_into_the_keys_of_the_arm_file():
    for effect_of_file, built in zip(EVERY_KIND, ALL.corrections, strict=True):
        table = {**effect_of_file.model_dump(exclude_none=True), **built.keys}
        assert effect_from_table(table) == effect_of_file


def test_parameters_have_names_of_their_own():
    names = ALL.parameter_names
    assert len(set(names)) == len(names) == len(ALL.values)
    assert "J3.encoder_eccentricity.cos_rad" in names
    assert "J1.encoder_harmonic.2.sin_rad" in names
    assert "J4.axis_runout.radial.2.cos_mm.x" in names
    assert "mount_compliance.compliance_rad_nm" in names
    assert "J5.empirical.J6_rad.values_rad.4" in names


def test_values_of_another_number_are_refused():
    with pytest.raises(ValueError, match=r"one for each of J3\.encoder_ecc"):
        ALL.with_values(np.zeros(3))
