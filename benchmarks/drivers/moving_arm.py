"""An arm that moves with an AMT21 encoder on each of its seven joints, and is read.

In virtual time nothing but the adapter's delays decides when a joint is read; in real
time the encoders are a process of their own behind a pty.
"""

import multiprocessing
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.tools.virtual_time import (
    FIRST_NS,
    Cable,
    Straight,
    VirtualTime,
    lines_through,
    played,
)
from traverse.arrays import Floats
from traverse.daemon.pose.arm_model import ArmModel, read_model
from traverse.drivers.amt21.driver import Amt21Driver, Amt21Options
from traverse.drivers.base.values import Delivery
from traverse.drivers.io.ports import PortAccess
from traverse.simulator.arm.trajectory import Trajectory, spline_pieces
from traverse.simulator.config import SimulatorConfig
from traverse.simulator.devices.amt21 import Amt21Table, SimulatedAmt21Line
from traverse.simulator.devices.device import DeviceContext
from traverse.simulator.pacing import MonotonicClock, live_real
from traverse.simulator.scenario.course import ClimateTable, Course
from traverse.simulator.scenario.faults import Fault
from traverse.simulator.scenario.script import Script
from traverse.simulator.scenario.truth_log import TruthLog
from traverse.simulator.scenario.wiring import ScriptClock, ScriptedCounts
from traverse.simulator.virtual_arm import build_arm

ARM = Path(__file__).parent.parent.parent / "cli" / "demo_data" / "arm.toml"
ADDRESSES = (0x54, 0x58, 0x5C, 0x60, 0x64, 0x68, 0x6C)
KNOT_S = 0.02


@dataclass(frozen=True, slots=True)
class Case:
    """An adapter and a motion.

    Attributes:
        exchange_s: duration of a request and its reply.
        jitter_s: random delay of replies, one in two.
        sway_hz: of a joint's swing at 1 rad/s; 0 for a steady 1 rad/s.
    """

    exchange_s: float
    jitter_s: float
    rate_hz: float
    sway_hz: float


def postures(at_s: Floats, sway_hz: float) -> Floats:
    """Every joint at 1 rad/s, or swinging with that speed at its fastest, (n, 7)."""
    start = np.array([0.1, -0.3, 0.4, 0.8, -0.2, 0.5, 0.0])
    if not sway_hz:
        return np.asarray(start + at_s[:, np.newaxis])
    w = 2.0 * np.pi * sway_hz
    phases = 0.7 * np.arange(len(start))
    return np.asarray(start + np.sin(w * at_s[:, np.newaxis] + phases) / w)


@dataclass(frozen=True, slots=True)
class Moving:
    """The moving arm, its seven encoders, and the daemon's model of it."""

    course: Course
    model: ArmModel
    mounting: DeviceContext
    table: Amt21Table


def moving(
    folder: Path,
    case: Case,
    seconds: float,
    faults: Sequence[Mapping[str, object]] = (),
) -> Moving:
    text = ARM.read_text("utf-8").replace("8388608", "16384")
    (folder / "arm.toml").write_text(text.replace("4194304", "16384"))
    table = Amt21Table(
        kind="amt21",
        id="base",
        port="line",
        addresses=ADDRESSES,
        baud_rate=2_000_000,
        request_delay_s=0.4 * case.exchange_s,
        reply_delay_s=0.6 * case.exchange_s - 0.5 * case.jitter_s,
    )
    config = SimulatorConfig.model_validate(
        {
            "schema": "traverse/simulator/1",
            "arm": {"file": "arm.toml"},
            "device": (table,),
            "motion": ({"kind": "rest", "duration_s": 1.0},),
        }
    )
    arm = build_arm(config, folder, "deskew")
    knots_s = np.arange(0.0, seconds + 2 * KNOT_S, KNOT_S)
    pieces = spline_pieces(knots_s, postures(knots_s, case.sway_hz))
    script = Script(Trajectory(knots_s, pieces), (), repeat=False)
    course = Course(script, arm.faulty, ClimateTable(), 0.0)
    late = {"kind": "late", "probability": 0.5, "delay_s": case.jitter_s}
    clock = ScriptClock(0.0)
    mounting = DeviceContext(
        folder,
        arm.encoders[0],
        ScriptedCounts(course, arm.encoders[0]),
        script,
        clock,
        tuple(Fault.from_table(fault) for fault in (late, *faults)),
        (1, 0),
        TruthLog(None, course, clock),
        ClimateTable(),
    )
    return Moving(
        course, read_model(folder / "arm.toml", {"base": None}), mounting, table
    )


def read_virtually(
    arm: Moving, case: Case, seconds: float
) -> tuple[list[Delivery], int]:
    """Return the driver's deliveries, and monotonic time 0 of the simulation."""
    now = VirtualTime(seconds)
    cable = Cable(now)
    with lines_through([cable]):
        now.devices.append(SimulatedAmt21Line(arm.table, arm.mounting))
    straight: Any = Straight(now.over)
    driver = Amt21Driver(
        "base",
        Amt21Options(port="line", addresses=ADDRESSES),
        straight,
        monotonic_ns=now.monotonic_ns,
        ports=PortAccess(cable.open_port, now.wait_for_any),
    )
    driver.request_stream(case.rate_hz)
    played(driver, now.over)
    return straight.all, FIRST_NS


def read_really(arm: Moving, case: Case, seconds: float) -> tuple[list[Delivery], int]:
    """Return the same through a pty, with the encoders in a process of their own."""
    clock = MonotonicClock()
    line = SimulatedAmt21Line(arm.table, arm.mounting)
    fork = multiprocessing.get_context("fork")
    life = fork.Process(
        target=live_real,
        args=([line], clock, arm.mounting.clock, None, lambda: False),
        daemon=True,
    )
    life.start()
    over = threading.Event()
    straight: Any = Straight(over)
    port = str(arm.mounting.folder / "line")
    driver = Amt21Driver("base", Amt21Options(port=port, addresses=ADDRESSES), straight)
    driver.request_stream(case.rate_hz)
    with driver:
        over.wait(seconds)
        over.set()
    life.terminate()
    life.join()
    line.close()
    return straight.all, clock.origin_ns
