import numpy as np
import pytest

from daemon.model import read_model
from kinematics.arm_file import FileError, arm_digest, read_arm
from tests.daemon.values import ARM, MODULI, arm_file, arm_model


def refused(tmp_path, text):
    with pytest.raises(FileError) as caught:
        read_model(arm_file(tmp_path, text), {"base": None})
    return str(caught.value)


def test_channels_are_in_the_order_of_the_joints(tmp_path):
    model = arm_model(tmp_path)
    assert model.channels.tolist() == [2, 0, 1]
    assert (model.name, model.device, model.probe_radius_mm) == ("bench-7", "base", 3)
    assert model.digest == arm_digest(read_arm(tmp_path / "arm.toml"))
    assert model.problems_with(MODULI) == []


def test_effects_that_cannot_be_applied_are_refused_all_together(tmp_path):
    effects = """
[[effects]]
kind = "encoder_eccentricity"
joint = "J2"
cos_rad = 3.1e-5
sin_rad = -1.2e-5
[[effects]]
kind = "thermal_expansion"
expansion_per_c = 1e-6
"""
    text = refused(tmp_path, ARM + effects)
    assert "effects[0]" in text
    assert "encoder_eccentricity" in text
    assert "effects[1]" in text
    assert "thermal_expansion" in text


def test_a_joint_without_encoder_and_one_on_an_unknown_device_are_told(tmp_path):
    broken = ARM.replace('source = "base/1"', 'source = "wrist/1"')
    start = broken.index("[joints.encoder]\ncounts_per_turn = 65536")
    end = broken.index("[[joints]]", start)
    text = refused(tmp_path, broken[:start] + broken[end:])
    assert "joints[0].encoder" in text
    assert "joints[2].encoder.source" in text
    assert "names device 'wrist'" in text
    assert "it has: base" in text


def test_joints_on_two_devices_are_refused(tmp_path):
    text = ARM.replace('source = "base/1"', 'source = "wrist/1"')
    with pytest.raises(FileError, match=r"several devices \(base, wrist\)"):
        read_model(arm_file(tmp_path, text), {"base": None, "wrist": None})


def test_a_modulus_must_be_whole_turns_and_a_channel_there(tmp_path):
    model = arm_model(tmp_path)
    few = model.problems_with((1 << 32, 1 << 23))
    assert few == [
        "joint 1 of the arm is on channel 2, but base has 2 channels, from 0"
    ]
    half_a_turn = model.problems_with((1 << 32, 1 << 22, 1 << 20))
    assert len(half_a_turn) == 1
    assert "joint 3 has 8388608 counts per turn" in half_a_turn[0]
    assert "4194304" in half_a_turn[0]
    assert model.problems_with((3_000_000, 1 << 23, 1 << 16))[0].startswith("joint 2")


def test_a_model_is_read_with_the_readings_of_the_file(tmp_path):
    model = arm_model(tmp_path)
    assert model.encoders.signs.tolist() == [1, -1, 1]
    assert np.allclose(model.encoders.zeros_rad, [1.234, -0.5, 0.25])
