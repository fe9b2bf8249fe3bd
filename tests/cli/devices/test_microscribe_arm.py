"""The arm file of a MicroScribe against matrices multiplied out here."""

import math
import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from traverse.cli.devices.microscribe_arm import (
    MicroscribeDescription,
    arm_from_microscribe,
)
from traverse.kinematics.arm_file.arm import read_arm, write_arm
from traverse.kinematics.model.forward import probe_pose
from traverse.kinematics.model.geometry import geometry_from_arm
from traverse.protocol.microscribe.session import Kinematics, kinematics_of
from traverse.strict_toml.problems import FileError

MAXES = (7999, 16383, 8191, 3999, 3999, 1023)
words = st.integers(-32768, 32767)
tables = st.lists(words, min_size=18, max_size=18)


def description(
    kinematics: Kinematics, n: int = 6, home: tuple[int, ...] = ()
) -> MicroscribeDescription:
    maxes = (*MAXES[:n], *[0] * (6 - n))
    return MicroscribeDescription("MS", "the arm", kinematics, maxes, home or (0,) * 6)


def matrix_pose(values: list[int], beta: int, counts: list[int]) -> np.ndarray:
    """The stylus by the definition: Rx(alpha) Tx(a) [Ry(beta)] Rz(theta) Tz(d)."""
    pose = np.eye(4)
    for k in range(6):
        alpha = math.pi * values[k] / 32768.0
        a_mm, d_mm = values[6 + k] * 25.4 / 1000.0, values[12 + k] * 25.4 / 1000.0
        theta = math.radians(counts[k] * 360.0 / (MAXES[k] + 1)) if counts[k] else 0.0
        ca, sa = math.cos(alpha), math.sin(alpha)
        cz, sz = math.cos(theta), math.sin(theta)
        about_x = np.array(
            [[1, 0, 0, a_mm], [0, ca, -sa, 0], [0, sa, ca, 0], [0, 0, 0, 1]]
        )
        about_z = np.array(
            [[cz, -sz, 0, 0], [sz, cz, 0, 0], [0, 0, 1, d_mm], [0, 0, 0, 1]]
        )
        pose = pose @ about_x
        if k == 2:
            b = math.pi * beta / 32768.0
            pose = pose @ np.array(
                [
                    [math.cos(b), 0, math.sin(b), 0],
                    [0, 1, 0, 0],
                    [-math.sin(b), 0, math.cos(b), 0],
                    [0, 0, 0, 1],
                ]
            )
        pose = pose @ about_z
    return pose


@given(
    tables,
    st.integers(-2000, 2000),
    st.integers(3, 6),
    st.lists(st.integers(0, 65535), min_size=6, max_size=6),
    st.lists(st.integers(0, 65535), min_size=6, max_size=6),
)
def test_points_of_the_arm_file_are_those_of_the_arms_own_table(
    values, beta, n, counts, home
):
    block = struct.pack(">19h", *values, beta)
    kinematics = kinematics_of(block, "Beta")
    assert kinematics.beta_rad == pytest.approx(math.pi * beta / 32768)
    counts = [c % (MAXES[k] + 1) if k < n else 0 for k, c in enumerate(counts)]
    home = tuple(c % (MAXES[k] + 1) for k, c in enumerate(home))
    arm = arm_from_microscribe(description(kinematics, n, home), "ms", 0.0)
    assert [joint.encoder.counts_per_turn for joint in arm.joints] == [
        MAXES[k] + 1 for k in range(n)
    ]
    readings = np.array([[2 * math.pi * counts[k] / (MAXES[k] + 1) for k in range(n)]])
    centre_mm, shank = probe_pose(geometry_from_arm(arm), readings)
    expected = matrix_pose(values, beta, counts)
    size_mm = sum(abs(v) for v in values[6:]) * 0.0254 + 1.0
    assert np.abs(centre_mm[0] - expected[:3, 3]).max() < 1e-11 * size_mm
    assert np.abs(shank[0] - expected[:3, 2]).max() < 1e-11


def example() -> Kinematics:
    quarter = math.pi / 2
    return Kinematics(
        (0.0, quarter, 0.0, -quarter, quarter, -quarter),
        (0.0, 19.0, 260.0, 19.0, 0.0, 0.0),
        (210.0, 0.0, 0.0, 230.0, 0.0, 145.0),
    )


def test_the_base_posture_is_the_home_position():
    arm = arm_from_microscribe(
        description(example(), home=(2000, 4096, 0, 0, 1000, 0)), "ms", 0.0
    )
    assert arm.joints[0].zero_rad == pytest.approx(math.pi / 2)
    assert arm.joints[1].zero_rad == pytest.approx(math.pi / 2)
    assert [joint.encoder.source for joint in arm.joints] == [
        f"ms/{k}" for k in range(6)
    ]
    assert {joint.encoder.sign for joint in arm.joints} == {1}


def test_the_file_holds_what_was_made(tmp_path: Path):
    arm = arm_from_microscribe(description(example()), "ms", 1.5)
    write_arm(tmp_path / "arm.toml", arm)
    assert read_arm(tmp_path / "arm.toml") == arm
    assert arm.probe.radius_mm == 1.5


@pytest.mark.parametrize(
    ("maxes", "expected"),
    [
        ((7999, 0, 7999, 0, 0, 0), "0 between others"),
        ((7999, 7999, 0, 0, 0, 0), "there are 2, expected 3 to 6"),
        ((7999,) * 7 + (0,), "there are 7, expected 3 to 6"),
        ((0,) * 6, "there are 0"),
    ],
)
def test_an_arm_that_its_table_cannot_describe_is_refused(maxes, expected):
    odd = replace(description(example()), maxes=maxes, home=(0,) * 8)
    with pytest.raises(FileError, match=expected):
        arm_from_microscribe(odd, "ms", 0.0)
