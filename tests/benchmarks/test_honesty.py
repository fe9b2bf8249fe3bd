"""Worlds of `make honesty`: that they run, and that lies in them are caught."""

import logging
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.honesty.families import FAMILIES
from benchmarks.honesty.plan import (
    FAULT_KINDS,
    LONE_KINDS,
    SCAN_KINDS,
    SLEW_PPM,
    Action,
    PlannedFault,
    draw_plan,
)
from benchmarks.honesty.table import verdict
from benchmarks.honesty.timeline import ClockFault, Timeline
from benchmarks.honesty.world import World, world_line
from traverse.protocol.messages.quality import Quality, QualityFlag


def quiet_plan(family: str, **changes):
    place = list(FAMILIES).index(family)
    plan = replace(draw_plan(place), pace="rest", duration_s=8.0, faults=())
    changes = {"is_identified": True, "is_confirmed": True} | changes
    return replace(plan, **changes)


def test_a_resting_arm_is_told_where_it_is(tmp_path):
    tally = World(quiet_plan("latch"), tmp_path).run().tally
    assert tally.ok["button"] >= 2
    assert tally.ok["live"] > 50
    assert not tally.lies


@pytest.mark.parametrize(
    ("utc_s", "falsified"),
    [
        (
            0.0,
            {
                (0.0, 0): False,
                (5.0, 0): True,
                (5.0, QualityFlag.INTERPOLATED): True,
                (5.0, QualityFlag.SKEW): False,
            },
        ),
        (3.0, {(0.0, 0): True, (0.0, QualityFlag.TIME_UNCERTAIN): False}),
    ],
)
def test_what_is_unmarked_and_wrong_is_a_lie(tmp_path, utc_s, falsified):
    """Points that are moved [mm], flagged, and whose UTC is off: whether each lies."""
    world = World(quiet_plan("text"), tmp_path)
    judge, judged = world.judge, []
    honest, shift_ns = judge.point, round(1e9 * utc_s)

    def lies(point, utc_offset_ns, moved_mm, flags):
        xyz_mm = np.array(point.xyz_mm) + np.array([0.0, 0.0, moved_mm])
        changes = {
            "xyz_mm": tuple(xyz_mm.tolist()),
            "time_ns": point.time_ns + shift_ns,
            "quality": Quality.from_bits(int(flags)),
        }
        before = sum(judge.tally.lies.values())
        honest(point.model_copy(update=changes), utc_offset_ns + shift_ns)
        return sum(judge.tally.lies.values()) - before

    def judge_falsified(point, utc_offset_ns):
        if "time_uncertain" in point.quality.flags:
            return  # of the first second: what it states is as wide as the arm
        judged.append({each: lies(point, utc_offset_ns, *each) for each in falsified})

    judge.point = judge_falsified
    world.run()
    assert judged
    assert all(n_lies == falsified for n_lies in judged)


def test_a_clock_is_where_its_faults_leave_it():
    stands, loses = ClockFault(2.0, stands_s=0.5), ClockFault(4.0, set_s=1.0)
    clock = Timeline(1.01, faults=[stands, loses])
    assert clock.at(1.0) == pytest.approx(1.01)
    assert clock.at(2.25) == pytest.approx(2.02)
    assert clock.at(3.0) == pytest.approx(2.525)
    assert clock.at(5.0) == pytest.approx(1.01 * 4.5 + 1.0)
    times_s = np.array([0.3, 1.7, 2.9, 3.9, 4.8, 90.0])
    shown_s = np.array([clock.at(time_s) for time_s in times_s])
    assert clock.true_array(shown_s) == pytest.approx(times_s)
    assert [clock.true(s) for s in shown_s] == pytest.approx(times_s)


def test_a_clock_drifts():
    clock = Timeline(1.0, drift_s=1e-4, drift_until_s=10.0)
    assert clock.at(10.0) == pytest.approx(10.0 + 0.5 * 1e-4 * 100.0, abs=1e-9)
    assert clock.at(11.0) - clock.at(10.0) == pytest.approx(1.001, abs=1e-9)


def test_every_fault_is_drawn_and_some_worlds_have_none():
    plans = [draw_plan(seed) for seed in (*range(600), 821, 1408, 3281, 3638, 4241)]
    kinds = {kind for plan in plans for kind in plan.kinds}
    in_scan = {f"scan+{kind}" for kind in (*SCAN_KINDS, "daemon_restart")}
    assert kinds == {*FAULT_KINDS, *LONE_KINDS, *in_scan, "none"}
    assert {plan.family for plan in plans} == set(FAMILIES)


@pytest.mark.parametrize(
    ("family", "kind", "size", "flag"),
    [
        ("latch2", "frozen_device", 0.0, "stale"),
        ("canopen", "bus_off", 0.0, "turns_uncertain"),
        ("latch", "host_slew", SLEW_PPM, ""),
        ("text", "unread", 0.02, "stale"),
    ],
)
def test_what_is_drawn_alone_is_marked(tmp_path, family, kind, size, flag):
    fault = PlannedFault(kind, 3.0, 8.0, size)
    changes = {"pace": "fast", "actions": (Action(2.5, "confirm"),)}
    plan = quiet_plan(family, faults=(fault,), duration_s=12.0, **changes)
    tally = World(plan, tmp_path).run().tally
    assert tally.ok["live"]
    assert not tally.lies, tally.examples
    assert not flag or any(flag in flags for flags in tally.doubts)


@pytest.mark.parametrize("is_bounded", [True, False])
def test_a_latched_press_is_judged_by_its_edge_and_its_time_by_itself(
    tmp_path, is_bounded
):
    """Delays leave open when it was; what nothing had bounded would be a lie."""
    plan = quiet_plan("latch", pace="fast", duration_s=20.0)
    world = World(replace(plan, delays_s=((8e-3, 4e-3, 0.0),)), tmp_path)
    if not is_bounded:
        honest, unbounded = world.judge.point, {"time_bound_ns": None}
        world.judge.point = lambda point, utc_offset_ns: honest(
            point.model_copy(update=unbounded), utc_offset_ns
        )
    tally = world.run().tally
    assert tally.ok["button"] >= 5
    assert tally.press_off_s > 1e-3
    assert (not tally.lies) == is_bounded
    assert is_bounded or "ms beside" in str(tally.examples[0])


@pytest.mark.parametrize(
    ("kind", "at_s", "lasts_s", "size"),
    [("device_stall", 3.5, 0.9, 0.9), ("delays", 1.0, 40.0, 0.015)],
)
def test_a_press_on_a_board_without_joints_is_as_late_as_it_may_be(
    tmp_path, kind, at_s, lasts_s, size
):
    """Its counter stops for a while, or its messages take 15 ms from then on."""
    fault = PlannedFault(kind, at_s, lasts_s, size, device=1)
    changes = {"duration_s": 14.0, "pace": "slow", "actions": (Action(0.5, "confirm"),)}
    plan = quiet_plan("latch+handle", faults=(fault,), **changes)
    tally = World(plan, tmp_path).run().tally
    assert tally.ok["button"] >= 3
    assert not tally.lies, tally.examples


def test_a_probe_whose_library_vanishes_stays_on_and_a_change_is_refused(tmp_path):
    actions = [Action(2.5, "confirm")]
    actions += [Action(at_s, "probe", at_s % 2) for at_s in (3.0, 4.0, 5.0, 7.0)]
    fault = PlannedFault("probe_table", 4.5, 2.0)
    changes = {"actions": tuple(actions), "duration_s": 8.0, "pace": "slow"}
    world = World(quiet_plan("latch", faults=(fault,), **changes), tmp_path)
    outcome = world.run()
    assert outcome.refused == {"capture.probe_refused": 1}
    assert [round(at_s, 1) for at_s, _ in world.truth.changes] == [3.0, 4.0, 7.0]
    assert outcome.tally.ok["live"] > 50
    assert not outcome.tally.lies, outcome.tally.examples


def test_a_line_of_a_world_is_judged():
    try:
        line = {"error": None, **world_line(4)}
    finally:
        logging.disable(logging.NOTSET)
    liar = {**line, "lies": {"live": 1}, "examples": ["live at 1 s"]}
    doubt = {"settled_doubt": {"live": 2}, "flags": {"time_uncertain": 2}}
    doubter = {**line, "kinds": ["none"], "lies": {}, **doubt}
    honest = {**doubter, "settled_doubt": {}, "flags": {}}
    assert verdict([honest]).holds
    quick = verdict([{**doubter, "flags": {"interpolated,skew": 2}}])
    assert quick.holds
    assert "and 2 in 1 worlds where the arm moved faster" in quick.text
    for wrong in (liar, doubter):
        judgement = verdict([honest, wrong])
        assert not judgement.holds
        assert "python -m benchmarks.honesty --seed 4 -v" in judgement.text
