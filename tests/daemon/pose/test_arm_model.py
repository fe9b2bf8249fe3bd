import numpy as np
import pytest

from tests.daemon.values import ARM, DEVICES, MODULI, arm_file, arm_model
from tests.established import identify
from traverse.daemon.pose.arm_model import read_model
from traverse.drivers.base.values import Identity
from traverse.kinematics.arm_file.arm import arm_digest, geometry_digest, read_arm
from traverse.strict_toml.problems import FileError


def device(moduli_counts, counts_per_turn=()):
    return Identity(
        "device", "1", moduli_counts, 0, 100.0, counts_per_turn=counts_per_turn
    )


def refused(tmp_path, text):
    with pytest.raises(FileError) as caught:
        read_model(arm_file(tmp_path, text), {"base": None})
    return str(caught.value)


def test_channels_are_in_the_order_of_the_joints(tmp_path):
    model = arm_model(tmp_path)
    assert model.channels.tolist() == [2, 0, 1]
    assert (model.name, model.probe_radius_mm) == ("bench-7", 3)
    assert (model.joint_devices, model.devices) == (("base",) * 3, ("base",))
    assert model.digest == arm_digest(read_arm(tmp_path / "arm.toml"))
    assert model.mismatches_with("base", device(MODULI)) == []


@pytest.mark.parametrize(
    ("old", "new", "is_in_doubt"),
    [
        ("link_mm = [0.0, 20.0, 200.0]", "link_mm = [0.0, 20.0, 205.0]", True),
        ("zero_rad = 0.25", "zero_rad = 0.35", True),
        ("sign = -1", "sign = 1", True),
        ("vector_mm = [0.0, 0.0, 50.0]", "vector_mm = [0.0, 0.0, 51.0]", True),
        ("[reference]", "[reference]  # of the room", False),
        ('name = "bench-7"', 'name = "bench-8"', False),
        ('source = "base/1"', 'source = "base/3"', False),
    ],
)
def test_an_arm_file_that_was_changed_since_its_identification_is_in_doubt(
    tmp_path, old, new, is_in_doubt
):
    path = identify(arm_file(tmp_path))
    digest = geometry_digest(read_arm(path))
    path.write_text(f'{path.read_text()}arm_digest = "{digest}"\n')
    assert not read_model(path, DEVICES).geometry_doubt

    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new))
    doubt = read_model(path, DEVICES).geometry_doubt
    assert ("has been changed since its identification" in doubt) == is_in_doubt


def empirical(covariate):
    return f"""
[[effects]]
kind = "empirical"
joint = "J2"
covariate = "{covariate}"
knots = [0.0, 10.0, 20.0]
values_rad = [0.0, 1e-5, 0.0]
"""


def test_effects_of_what_a_daemon_never_knows_are_refused_all_together(tmp_path):
    effects = empirical("J1_rad") + empirical("time_s") + empirical("force_n")
    text = refused(tmp_path, ARM + effects)
    assert "effects[0]" not in text
    for parts in (
        "effects[1]",
        "J2.empirical.time_s depends on the time since the start of a campaign",
        "effects[2]",
        "J2.empirical.force_n depends on the force of a contact",
        "Take it out of the arm file",
    ):
        assert parts in text


def test_an_effect_that_does_not_fit_the_arm_is_refused_with_the_rest(tmp_path):
    compliance = '[[effects]]\nkind = "mount_compliance"\ncompliance_rad_nm = 1e-6\n'
    broken = ARM.replace('source = "base/1"', 'source = "wrist/1"')
    text = refused(tmp_path, broken + compliance)
    assert "joints[2].encoder.source" in text
    assert "effects[0]: mount_compliance yields to weights" in text


@pytest.mark.parametrize(
    ("epoch", "at_s"), [("2925-01-01", 0.0), ("1625-01-01", 0.0), ("2025-01-01", 1e10)]
)
def test_a_moment_that_samples_never_reach_is_refused(tmp_path, epoch, at_s):
    slip = """
[[effects]]
kind = "count_slip"
joint = "J1"
at_s = {}
step_rad = 1e-5
epoch_utc = {}T00:00:00Z
"""
    text = refused(tmp_path, ARM + slip.format(at_s, epoch))
    assert "effects[0].epoch_utc" in text
    assert "correct the date" in text
    good = arm_model(tmp_path, ARM + slip.format(60.0, "2025-01-01"))
    assert good.effect_names == ["J1.count_slip.60s"]


def test_the_effects_in_line_are_those_of_the_file_but_of_standards(tmp_path):
    length = '[[effects]]\nkind = "artefact_length"\nartefact = "b"\nerror_ppm = 2.0\n'
    model = arm_model(tmp_path, ARM + length + empirical("J1_temperature_c"))
    assert model.effect_names == ["J2.empirical.J1_temperature_c"]
    assert model.uses_temperature
    off_line_only = arm_model(tmp_path, ARM + length)
    assert (off_line_only.effect_names, off_line_only.uses_temperature) == ([], False)


def test_a_joint_without_encoder_and_one_on_an_unknown_device_are_reported(tmp_path):
    broken = ARM.replace('source = "base/1"', 'source = "wrist/1"')
    start = broken.index("[joints.encoder]\ncounts_per_turn = 65536")
    end = broken.index("[[joints]]", start)
    text = refused(tmp_path, broken[:start] + broken[end:])
    assert "joints[0].encoder" in text
    assert "joints[2].encoder.source" in text
    assert "names device 'wrist'" in text
    assert "it has: base" in text


def test_joints_may_be_on_several_devices(tmp_path):
    text = ARM.replace('source = "base/1"', 'source = "wrist/1"')
    model = read_model(arm_file(tmp_path, text), {"base": None, "wrist": None})
    assert model.joint_devices == ("base", "base", "wrist")
    assert model.devices == ("base", "wrist")
    assert model.channels.tolist() == [2, 0, 1]
    # Each device is used for its own joints only.
    assert model.mismatches_with("wrist", device((1, 1 << 23))) == []
    (missing,) = model.mismatches_with("wrist", device((1 << 23,)))
    assert "joint 3 of the arm is on channel 1, but wrist has 1 channel" in missing


def test_a_modulus_must_be_whole_turns_and_a_channel_there(tmp_path):
    model = arm_model(tmp_path)
    few = model.mismatches_with("base", device((1 << 32, 1 << 23)))
    assert few == [
        "joint 1 of the arm is on channel 2, but base has 2 channels, from 0"
    ]
    half_a_turn = model.mismatches_with("base", device((1 << 32, 1 << 22, 1 << 20)))
    assert len(half_a_turn) == 1
    assert "joint 3 has 8388608 counts per turn" in half_a_turn[0]
    assert "4194304" in half_a_turn[0]
    third = model.mismatches_with("base", device((3_000_000, 1 << 23, 1 << 16)))
    assert third[0].startswith("joint 2")


def test_what_a_device_says_of_its_turns_must_be_what_the_file_says(tmp_path):
    model = arm_model(tmp_path)
    fits = device(MODULI, (1 << 20, None, 1 << 16))
    assert model.mismatches_with("base", fits) == []
    # Whole turns of the file fit into its modulus, and yet it is another resolution.
    (mismatches,) = model.mismatches_with(
        "base", device(MODULI, (1 << 19, 1 << 23, 1 << 16))
    )
    assert mismatches == (
        "joint 2 has 1048576 counts per turn in the arm file, but channel 0 of base "
        "reports 524288"
    )
    assert model.mismatches_with("base", device(MODULI, ())) == []


def test_a_model_is_read_with_the_readings_of_the_file(tmp_path):
    model = arm_model(tmp_path)
    assert model.encoders.signs.tolist() == [1, -1, 1]
    assert np.allclose(model.encoders.zeros_rad, [1.234, -0.5, 0.25])
