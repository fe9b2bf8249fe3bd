"""Arms as robot descriptions: read by a multiplication of transforms written out here,
and by the importer.
"""

import math
import tempfile
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.kinematics.arms import ARM_TEXT, random_geometry, seeds, size_mm
from tests.kinematics.importers.matrices import rotation
from traverse.kinematics.arm_file.arm import parse_arm
from traverse.kinematics.importers.arm_values import JointParts, assemble_arm
from traverse.kinematics.importers.urdf import Body, Mimic, arm_from_chain
from traverse.kinematics.importers.urdf_chain import chain_of
from traverse.kinematics.importers.urdf_file import read_urdf
from traverse.kinematics.importers.urdf_report import urdf_report
from traverse.kinematics.model.forward import probe_pose
from traverse.kinematics.model.geometry import geometry_from_arm

HARMONIC = """
[[effects]]
kind = "encoder_eccentricity"
joint = "J1"
cos_rad = 1e-4
sin_rad = 0.0
"""
DRIFT = """
[[effects]]
kind = "base_drift"
epoch_utc = 2026-01-01T00:00:00Z
rate_mm_s = [0.001, 0.0, 0.0]
"""


def numbers(element, key):
    return [float(word) for word in element.get(key).split()]


def probe_of(text, values_rad):
    """The frame of the link `probe` of a description, joints at values: (4, 4) [m]."""
    pose = np.eye(4)
    joints = {j.find("child").get("link"): j for j in ET.fromstring(text).iter("joint")}
    way, link = [], "probe"
    while link in joints:
        way.insert(0, joints[link])
        link = joints[link].find("parent").get("link")
    assert link == "base"
    for joint in way:
        origin = joint.find("origin")
        place = np.eye(4)
        place[:3, 3] = numbers(origin, "xyz")
        roll, pitch, yaw = map(rotation, np.eye(3), numbers(origin, "rpy"))
        pose = pose @ place @ yaw @ pitch @ roll
        if joint.get("type") == "continuous":
            mimic = joint.find("mimic")
            if mimic is None:
                value = values_rad[joint.get("name")]
            else:
                value = values_rad[mimic.get("joint")]
                value = float(mimic.get("multiplier")) * value
                value += float(mimic.get("offset"))
            pose = pose @ rotation(numbers(joint.find("axis"), "xyz"), value)
    return pose


@st.composite
def arms(draw):
    """Arms without symmetry, some joints coupled; their readings, one of them each."""
    n, seed = draw(st.integers(1, 7)), draw(seeds)
    rng = np.random.default_rng(seed)
    free = {0, *(k for k in range(n) if draw(st.booleans()))}
    parts = [
        JointParts(
            name=f"J{k}",
            counts_per_turn=4096 if k in free else None,
            sign=1,
            source=f"base/{k}",
            body=Body(rng.uniform(0.1, 2.0), rng.uniform(-99, 99, 3)),
            mimic=None
            if k in free
            else Mimic(f"J{draw(st.sampled_from(sorted(free)))}", rng.normal(), 0.0),
        )
        for k in range(n)
    ]
    arm = assemble_arm("random", random_geometry(seed, n), parts, "test", radius_mm=2.0)
    if len(free) > 1:  # one that is read and coupled, too, as wrists of robots are
        last, joints = max(free), list(arm.joints)
        coupling = {"coupled_to": "J0", "ratio": rng.normal()}
        joints[last] = joints[last].model_copy(update=coupling)
        arm = arm.model_copy(update={"joints": tuple(joints)})
    zeros_rad = np.array([joint.zero_rad for joint in arm.joints])
    turns_rad = rng.uniform(-4, 4, n) * [k in free for k in range(n)]
    return arm, zeros_rad + turns_rad


@given(arms())
def test_a_description_places_the_probe_where_the_arm_does(drawn):
    arm, readings_rad = drawn
    geometry = geometry_from_arm(arm)
    (centre_mm,), (shank,) = probe_pose(geometry, readings_rad[np.newaxis])
    report, text = urdf_report(arm, 1, 1)
    values_rad = dict(zip((j.name for j in arm.joints), readings_rad, strict=True))
    probe = probe_of(text, values_rad)
    tolerance_mm = 1e-12 * size_mm(geometry)
    np.testing.assert_allclose(1e3 * probe[:3, 3], centre_mm, rtol=0, atol=tolerance_mm)
    np.testing.assert_allclose(probe[:3, 2], shank, rtol=0, atol=1e-11)
    assert report["loss_mm"]["max"] == 0.0


@given(arms())
def test_the_importer_reads_the_same_arm(drawn):
    arm, readings_rad = drawn
    geometry = geometry_from_arm(arm)
    (centre_mm,), (shank,) = probe_pose(geometry, readings_rad[np.newaxis])
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "arm.urdf"
        file.write_text(urdf_report(arm, 1, 1)[1], "utf-8")
        chain = chain_of(read_urdf(file), None, None)
    values_rad = dict(zip((j.name for j in arm.joints), readings_rad, strict=True))
    turning = [joint for joint in chain if joint.axis is not None]
    posture_rad = [
        values_rad[j.name]
        if j.mimic is None
        else j.mimic.ratio * values_rad[j.mimic.joint] + j.mimic.offset_rad
        for j in turning
    ]
    made = arm_from_chain(chain, np.eye(4), np.zeros(len(turning)))
    centres_mm, shanks = probe_pose(made.geometry, np.array([posture_rad]))
    tolerance_mm = 1e-12 * size_mm(geometry)
    np.testing.assert_allclose(centres_mm[0], centre_mm, rtol=0, atol=tolerance_mm)
    np.testing.assert_allclose(shanks[0], shank, rtol=0, atol=1e-11)
    masses_kg = [body.mass_kg for body in made.bodies if body is not None]
    assert sum(masses_kg) == pytest.approx(sum(j.mass_kg for j in arm.joints))


def test_the_loss_is_what_the_effects_move_the_probe():
    """J1 turns by 1e-4 rad cos(alpha) more: the ball moves by that times its lever."""
    text = ARM_TEXT.replace("[probe]", HARMONIC.replace("J1", "J2") + "\n[probe]")
    report, _ = urdf_report(parse_arm(text), 20_000, 5)
    largest_mm = 350.0 * 1e-4  # J2 bears the link of 300 mm and the probe of 50 mm
    assert report["loss_mm"]["max"] == pytest.approx(largest_mm, rel=1e-4)
    assert report["loss_mm"]["rms"] == pytest.approx(
        largest_mm / math.sqrt(2), rel=0.02
    )
    assert (report["loss_mm"]["postures"], report["loss_mm"]["seed"]) == (20_000, 5)


def test_what_a_description_cannot_hold_is_said_in_it():
    text = ARM_TEXT.replace('"J1"', '"J--1"') + HARMONIC.replace("J1", "J--1") + DRIFT
    report, written = urdf_report(parse_arm(text), 10, 1)
    assert report["not_in_loss"] == ["base_drift"]
    assert report["loss_mm"]["max"] > 0.0
    remarks = " ".join(report["not_in_urdf"])
    for expected in (
        "J--1.encoder_eccentricity",
        "base_drift",
        "encoders",
        "inertias of 0",
    ):
        assert expected in remarks
    comments = written.split('<link name="base"')[0]
    assert "J- -1.encoder_eccentricity, base_drift" in comments
    assert f"largest {report['loss_mm']['max']:.3g} mm" in comments
    probe = probe_of(written, {"J--1": 1.234, "J2": -0.5})
    np.testing.assert_allclose(probe[:3, 3], [0.001, 0.008, 0.6035], atol=1e-15)
