import csv
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.strangers import plain
from benchmarks.strangers.sets import make_arm, read_sets
from benchmarks.strangers.table import distances_mm, nominal_and_campaign
from traverse.kinematics.arm_file.arm import read_arm
from traverse.kinematics.model.forward import probe_centre
from traverse.kinematics.model.geometry import geometry_from_arm
from traverse.lab.campaign.campaign import read_campaign
from traverse.lab.identification.identify import identify
from traverse.lab.identification.prediction import placed

NOISE_MM = 0.05
URDF = """<robot name="four">
{links}
{joints}
<joint name="end" type="fixed"><parent link="l4"/><child link="ball_link"/>
<origin xyz="0.05 0 0.1" rpy="0 0 0"/></joint><link name="ball_link"/>
</robot>"""
AXES = ("0 0 1", "0 1 0", "0 1 0", "1 0 0")


@pytest.fixture
def folder(tmp_path):
    """A UR5 whose fourth link is 2 mm too long, in the frame of a tracker."""
    (tmp_path / "ur5").mkdir()
    head = ["x_t", "y_t", "z_t", "x_dif", "y_dif", "z_dif"]
    head += [f"joint_{k}" for k in range(1, 7)]
    for name in ("grid", "random"):
        with (tmp_path / "ur5" / f"{name}.csv").open("w") as file:
            csv.writer(file).writerows([head, [0.0] * 12])
    (nominal,) = read_sets(tmp_path)
    arm = read_arm(make_arm(nominal, tmp_path))
    chain = plain.chain_of(arm)
    chain.links_mm[3] += [0.0, 0.0, 2.0]
    rng = np.random.default_rng(3)
    for name, n in (("grid", 60), ("random", 10)):
        angles_deg = rng.uniform(-120.0, 120.0, (n, 6))
        places_mm = chain.places_mm(np.radians(angles_deg))
        turned = places_mm[:, [1, 2, 0]] + [300.0, -20.0, 5.0]
        seen = turned + rng.normal(0.0, NOISE_MM, (n, 3))
        off = rng.normal(0.0, 2.0, (n, 3))
        rows = np.hstack([seen + off, off, angles_deg]).tolist()
        with (tmp_path / "ur5" / f"{name}.csv").open("w") as file:
            csv.writer(file).writerows([head, *rows])
    return tmp_path


@pytest.mark.slow
def test_both_ways_find_the_arm_again(folder):
    (measured,) = read_sets(folder)
    assert measured.is_kept.sum() == 10
    arm = read_arm(folder / "arm.toml")
    _, campaign = nominal_and_campaign(measured)
    tool = plain.fitted(plain.chain_of(arm), measured, tool_only=True)
    rival = plain.fitted(tool, measured)
    tool_mm, plainly_mm = (
        plain.held_out_mm(chain.places_mm(measured.angles_rad), measured)
        for chain in (tool, rival)
    )
    ours_mm = distances_mm(measured, identify(campaign, arm).arm)
    assert tool_mm.mean() > 10 * NOISE_MM
    for found_mm in (plainly_mm, ours_mm):
        assert found_mm.mean() < 3 * NOISE_MM
    # With the tool alone fitted the two ways agree on how far off the arm is.
    held = placed(campaign, arm, with_tool=True).arm
    assert distances_mm(measured, held).mean() == pytest.approx(
        tool_mm.mean(), rel=0.02
    )


@pytest.mark.parametrize("was_moved", [False, True])
def test_one_yardstick_for_a_chain_and_for_an_arm_file(folder, was_moved):
    (measured,) = read_sets(folder)
    measured = replace(measured, was_moved=was_moved)
    arm = read_arm(folder / "arm.toml")
    of_chain_mm = plain.chain_of(arm).places_mm(measured.angles_rad)
    np.testing.assert_allclose(
        distances_mm(measured, arm), plain.held_out_mm(of_chain_mm, measured), atol=1e-9
    )


def test_its_chain_is_that_of_the_arm_file(folder):
    (measured,) = read_sets(folder)
    arm = read_arm(folder / "arm.toml")
    ours = probe_centre(geometry_from_arm(arm), measured.angles_rad)
    theirs = plain.chain_of(arm).places_mm(measured.angles_rad)
    np.testing.assert_allclose(theirs + arm.origin_mm, ours, atol=1e-9)


def test_sockets_of_a_gauge_are_read_and_kept_aside_by_place(tmp_path):
    robot = tmp_path / "mukca" / "panda_1"
    links = "".join(f'<link name="l{k}"/>' for k in range(5))
    joints = "".join(
        f'<joint name="j{k}" type="revolute">'
        f'<parent link="l{k}"/><child link="l{k + 1}"/>'
        f'<origin xyz="0 0 0.3" rpy="0 0 0"/><axis xyz="{axis}"/>'
        '<limit lower="-3" upper="3" effort="1" velocity="1"/></joint>'
        for k, axis in enumerate(AXES)
    )
    for number, place in enumerate(("a", "b", "c")):
        (robot / place).mkdir(parents=True)
        for hole in (0, 1):
            rows = np.full((2, 4), 0.1 * number + 0.01 * hole)
            np.savetxt(robot / place / f"hole_{hole}.csv", rows, delimiter=",")
    text = URDF.format(links=links, joints=joints)
    (tmp_path / "mukca" / "panda.urdf").write_text(text)
    (measured,) = read_sets(tmp_path)
    assert measured.is_kept.tolist() == [False] * 4 + [True] * 4 + [False] * 4
    assert measured.sockets[:3] == [("a", "1"), ("a", "1"), ("a", "2")]
    arm = read_arm(make_arm(measured, tmp_path))
    folder = measured.write(tmp_path / "used", ~measured.is_kept)
    campaign = read_campaign(folder, [joint.name for joint in arm.joints])
    assert [artefact.id for artefact in campaign.artefacts] == ["a", "c"]
    assert len(campaign.poses) == 8
    # Both sockets of a place lie 0 mm from their mean: each was touched in one posture.
    at_mm = plain.chain_of(arm).places_mm(measured.angles_rad)
    assert plain.held_out_mm(at_mm, measured) == pytest.approx(0.0)
