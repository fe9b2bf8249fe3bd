import json
from collections.abc import Callable
from datetime import timedelta
from pathlib import Path

import numpy as np
import pytest

from tests.simulator.conftest import config_text
from tests.simulator.effects.examples import START, example, heavy_arm
from traverse.kinematics.arm_file.arm import Arm, write_arm
from traverse.kinematics.effects.arm_effects import effects_of
from traverse.kinematics.effects.base.block import Block
from traverse.kinematics.effects.base.context import utc_ns
from traverse.kinematics.effects.pose import corrected_pose
from traverse.kinematics.model.geometry import geometry_from_arm
from traverse.simulator.arm.physics import probe_pose
from traverse.simulator.arm.trajectory import Trajectory, move_pieces, rest_pieces
from traverse.simulator.campaigns import true_arm_file
from traverse.simulator.config import SimulatorConfig, config_problems
from traverse.simulator.scenario.course import ClimateTable, Course, contact_directions
from traverse.simulator.scenario.script import Script
from traverse.simulator.scenario.signals import LatchedEdge
from traverse.simulator.scenario.truth_log import TruthLog
from traverse.simulator.scenario.wiring import ScriptClock, ScriptedCounts, Wiring
from traverse.simulator.virtual_arm import (
    VirtualArm,
    build_arm,
    build_course,
    build_script,
)
from traverse.strict_toml.reader import parse_strict

SPHERE = """
[[motion]]
kind = "sphere"
centre_mm = [500.0, 100.0, 50.0]
radius_mm = 30.0
points = 3
"""
HEAD = f"start_utc = {START.isoformat()}"
CLIMATE = "[climate]\ndrift_c_s = 0.2\nswing_c = 1.0\nswing_period_s = 5.0\n"
Played = tuple[Arm, VirtualArm, Script, Course]


@pytest.fixture
def played(tmp_path: Path) -> Callable[..., Played]:
    def play(*effects) -> Played:
        arm = heavy_arm().model_copy(update={"effects": tuple(effects)})
        write_arm(tmp_path / "arm.toml", arm)
        text = config_text(SPHERE, HEAD, CLIMATE)
        config = parse_strict(text, "sim.toml", SimulatorConfig, config_problems)
        virtual = build_arm(config, tmp_path, "sim.toml")
        script = build_script(config, virtual, tmp_path, "sim.toml")
        return arm, virtual, script, build_course(config, virtual, script)

    return play


# Of probe_lobing and stylus_bending the formula holds in contact only, see below.
KINDS = ["encoder_eccentricity", "encoder_latency", "backlash", "encoder_drift"]
KINDS += ["encoder_temperature", "joint_compliance", "mount_compliance"]
KINDS += ["thermal_expansion", "base_drift", "axis_wobble"]
TOUCHING = ["probe_radius", "probe_lobing", "stylus_bending"]


def corrected_mm(arm: Arm, virtual: VirtualArm, script: Script, times_s, readings_rad):
    """Position of the ball by an arm file with the effects, given the surroundings."""
    true = true_arm_file(arm, virtual.truth)
    temperature_c = 20.0 + 0.2 * times_s + np.sin(2.0 * np.pi / 5.0 * times_s)
    block = Block(
        angles_rad=readings_rad,
        speeds_rad_s=script.speeds(times_s),
        approaches=script.senses(times_s),
        temperature_c=temperature_c,
        utc_ns=utc_ns(START) + np.rint(times_s * 1e9).astype(np.int64),
        directions=contact_directions(script).at(times_s),
    )
    span = (START, START + timedelta(hours=1))
    effects = effects_of(true, true.effects, span)
    return corrected_pose(geometry_from_arm(true), effects, block)[0]


# A script lasts seconds, a campaign minutes.
FASTER = {
    "encoder_drift": {"rate_rad_s": 1e-5},
    "base_drift": {"rate_mm_s": [0.01, -0.01, 0.02]},
}


@pytest.mark.parametrize("kind", KINDS)
def test_the_true_ball_is_what_the_correction_finds_all_along(played, kind):
    effect = example(kind, **FASTER.get(kind, {}))
    arm, virtual, script, course = played(effect)
    times_s = np.linspace(0.0, script.duration_s, 997)
    readings_rad = course.readings_rad(times_s)
    centres_mm, _ = course.probe(times_s)
    found_mm = corrected_mm(arm, virtual, script, times_s, readings_rad)
    # Effects of speed are taken from the script's, before the joints give way.
    np.testing.assert_allclose(found_mm, centres_mm, rtol=0, atol=1e-8)
    bare = arm.model_copy(update={"effects": ()})
    wrong_mm = corrected_mm(bare, virtual, script, times_s, readings_rad) - centres_mm
    assert np.max(np.abs(wrong_mm)) > 1e-3


@pytest.mark.parametrize("kind", KINDS + TOUCHING)
def test_the_ball_touches_at_every_press(played, kind):
    arm, virtual, script, course = played(example(kind))
    times_s = np.array([event.time_s for event in script.events])
    surfaces_mm = np.array([event.surface_mm for event in script.events])
    normals = np.array([event.normal for event in script.events])
    touching_mm = surfaces_mm + arm.probe.radius_mm * normals
    np.testing.assert_allclose(course.probe(times_s)[0], touching_mm, atol=1e-6)
    readings_rad = course.readings_rad(times_s)
    found_mm = corrected_mm(arm, virtual, script, times_s, readings_rad)
    np.testing.assert_allclose(found_mm, touching_mm, rtol=0, atol=1e-6)


def test_a_board_latches_the_effect(played, tmp_path):
    _, virtual, script, course = played(example("backlash"), example("base_step"))
    wiring = Wiring(
        ScriptedCounts(course, virtual.encoders[0]),
        script,
        ScriptClock(5.0),
        inputs=["button"],
        faults=[],
        moduli=virtual.encoders[0].moduli,
        seed=(1, 0),
    )
    times_s = np.linspace(0.0, script.duration_s, 100)
    counts, _ = wiring.latch(5.0 + times_s, edge=False)
    quiet = np.random.default_rng(0)
    readings_rad = course.readings_rad(times_s)
    expected = virtual.encoders[0].counts(readings_rad, quiet)
    # The clock's times are rounded: a count more or less where the arm moves.
    off = (counts.astype(np.int64) - expected + 2**22) % 2**23 - 2**22
    assert np.max(np.abs(off)) <= 1
    rigid_rad = script.turns(times_s) + virtual.truth.zeros_rad
    rigid = virtual.encoders[0].counts(rigid_rad, quiet)
    off = (counts.astype(np.int64) - rigid + 2**22) % 2**23 - 2**22
    assert np.min(np.abs(off[10:, 3])) > 100


def test_the_truth_log_tells_the_true_ball(played, tmp_path):
    _, _, script, course = played(example("joint_compliance"))
    event = script.events[0]
    edge = LatchedEdge(event.time_s, 0, 1, 1, 0, np.zeros(7), np.zeros(7), event)
    with TruthLog(tmp_path / "truth.jsonl", course, ScriptClock(0.0)) as log:
        log.edge("base", 0, edge)
    line = json.loads((tmp_path / "truth.jsonl").read_text())
    touching_mm = np.array(event.surface_mm) + 3.0 * np.array(event.normal)
    np.testing.assert_allclose(line["centre_mm"], touching_mm, atol=1e-6)
    now_s = np.array([event.time_s])
    assert line["angles_rad"] == course.readings_rad(now_s)[0].tolist()
    assert np.max(np.abs(course.turns_rad(now_s) - script.turns(now_s))) > 1e-5


def test_blocks_do_not_matter(played):
    _, _, script, course = played(example("joint_compliance"))
    times_s = np.linspace(0.0, script.duration_s, 400)
    whole_rad = course.readings_rad(times_s)
    parts = [course.readings_rad(part) for part in np.array_split(times_s, 57)]
    np.testing.assert_array_equal(np.concatenate(parts), whole_rad)


def test_without_effects_readings_are_turns_and_zeros(played):
    _, virtual, script, course = played()
    times_s = np.linspace(0.0, script.duration_s, 50)
    expected_rad = script.turns(times_s) + virtual.truth.zeros_rad
    np.testing.assert_array_equal(course.readings_rad(times_s), expected_rad)
    centres_mm, shanks = probe_pose(virtual.truth.mechanism, script.turns(times_s))
    np.testing.assert_allclose(course.probe(times_s)[0], centres_mm, atol=1e-9)
    np.testing.assert_allclose(course.probe(times_s)[1], shanks, atol=1e-12)


def test_speeds_and_senses_follow_the_course():
    forward, back = np.array([1.0, 0.0]), np.array([0.5, 0.0])
    pieces = [
        move_pieces(np.zeros(2), forward),
        rest_pieces(forward),
        move_pieces(forward, back),
    ]
    trajectory = Trajectory(np.array([0.0, 1.0, 2.0, 4.0]), np.concatenate(pieces))
    times_s = np.linspace(0.05, 3.95, 40)
    slopes = trajectory.turns(times_s + 1e-6) - trajectory.turns(times_s - 1e-6)
    np.testing.assert_allclose(trajectory.speeds(times_s), slopes / 2e-6, atol=1e-7)
    at_s = np.array([0.0, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 9.0])
    senses = trajectory.senses(at_s)
    assert senses[:, 0].tolist() == [0.0, 1.0, 1.0, 1.0, 1.0, -1.0, -1.0, -1.0]
    assert not senses[:, 1].any()
    repeated = Script(trajectory, (), repeat=True).senses(np.array([0.0, 4.0, 4.5]))
    assert repeated[:, 0].tolist() == [0.0, -1.0, 1.0]


def test_the_climate_drifts_and_swings():
    climate = ClimateTable(drift_c_s=0.01, swing_c=2.0, swing_period_s=100.0)
    found_c = climate.change_c(np.array([0.0, 25.0, 50.0, 75.0]))
    np.testing.assert_allclose(found_c, [0.0, 2.25, 0.5, -1.25], atol=1e-12)
