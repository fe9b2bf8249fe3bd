"""The simulated arm of `drivers_bar` with the devices of one make on it."""

import multiprocessing
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.drivers.bar_devices import Make
from traverse.arrays import Floats
from traverse.simulator.arm.physics import probe_pose
from traverse.simulator.config import SimulatorConfig
from traverse.simulator.devices.device import (
    DeviceContext,
    SimulatedDevice,
    make_device,
)
from traverse.simulator.pacing import MonotonicClock, live_real
from traverse.simulator.scenario.course import ClimateTable, Course
from traverse.simulator.scenario.script import Script
from traverse.simulator.scenario.wiring import ScriptedCounts
from traverse.simulator.truth_log import TruthLog
from traverse.simulator.virtual_arm import (
    VirtualArm,
    build_arm,
    build_course,
    build_script,
)

STEP_RAD = 1e-6
DISTANCE_MM, RADIUS_MM = 500.0, 25.4  # of the bar and its spheres
OPERATOR = {"move_s": 1.0, "approach_s": 0.2, "dwell_s": 0.4, "press_s": 0.1}


class Begun:
    """A `ScriptClock` that begins when another process says so, and not before."""

    def __init__(self) -> None:
        fork = multiprocessing.get_context("fork")
        self._begin_s = fork.Value("d", -1.0)
        self._ended = fork.Event()

    @property
    def begin_s(self) -> float | None:
        """Time of the simulation; None as long as nobody has said."""
        return None if self._begin_s.value < 0.0 else self._begin_s.value

    def set(self, time_s: float) -> None:
        """Say it."""
        self._begin_s.value = time_s

    def end(self) -> None:
        """Let the devices end, whatever the script says."""
        self._ended.set()

    def is_over(self) -> bool:
        """They shall end, or nobody is there any more."""
        return self._ended.is_set() or os.getppid() == 1

    def begin(self, time_s: float) -> None:
        """A reading does not begin the script here."""
        del time_s

    def script_s(self, time_s: float) -> float:
        """Time of the script."""
        begin_s = self.begin_s
        return 0.0 if begin_s is None else max(0.0, time_s - begin_s)


@dataclass(frozen=True, slots=True)
class Stage:
    """The arm, its motion, and what reads it.

    Attributes:
        touched_mm: the ball's centre is so far from that of the sphere it touches.
    """

    make: Make
    folder: Path
    arm: VirtualArm
    script: Script
    course: Course
    table: Any
    begun: Any
    touched_mm: float

    @property
    def presses_s(self) -> Floats:
        """Presses of the button, from the begin of the script."""
        return np.array([e.time_s for e in self.script.events if e.level])

    def presses_ns(self, origin_ns: int) -> list[int]:
        """The same on the host's clock, which showed ``origin_ns`` at time 0."""
        begun_s = self.begun.begin_s + self.presses_s
        return [origin_ns + round(1e9 * at_s) for at_s in begun_s.tolist()]

    def jacobians_mm(self) -> Floats:
        """By how much the ball moves with each joint at the presses, (n, 3, n_joints).

        By differences of the simulator's own physics.
        """
        turns_rad = self.script.turns(self.presses_s)
        mechanism = self.arm.truth.mechanism
        columns = []
        for step_rad in STEP_RAD * np.eye(turns_rad.shape[1]):
            ahead, _ = probe_pose(mechanism, turns_rad + step_rad)
            behind, _ = probe_pose(mechanism, turns_rad - step_rad)
            columns.append((ahead - behind) / (2.0 * STEP_RAD))
        return np.stack(columns, axis=-1)

    def device(self) -> SimulatedDevice:
        """The device on its ports."""
        encoders = self.arm.encoders[0]
        mounting = DeviceContext(
            self.folder,
            encoders,
            ScriptedCounts(self.course, encoders),
            self.script,
            self.begun,
            (),
            (1, 0),
            TruthLog(None, self.course, self.begun),
            ClimateTable(),
        )
        return make_device(self.table, mounting)

    def live(self, clock: MonotonicClock) -> None:
        """Be the device until the motion is over; for a process of its own."""
        device = self.device()
        end_s = self.script.duration_s
        live_real([device], clock, self.begun, end_s, self.begun.is_over)
        device.close()


def staged(make: Make, points: int, folder: Path) -> Stage:
    """Build the arm with one make of encoders; the motion is the same for all."""
    (folder / "arm.toml").write_text(make.arm_text(), "utf-8")
    bar = {
        "kind": "ball_bar",
        "centre_mm": (550.0, 0.0, 100.0),
        "direction": (0.0, 1.0, 0.0),
        "distance_mm": DISTANCE_MM,
        "radius_mm": RADIUS_MM,
        "points": points,
    }
    config = SimulatorConfig.model_validate(
        {
            "schema": "traverse/simulator/1",
            "arm": {"file": "arm.toml"},
            "operator": OPERATOR,
            "device": ({"kind": make.name, "id": make.name, **make.table},),
            "motion": (bar, {"kind": "rest", "duration_s": 0.3}),
        }
    )
    arm = build_arm(config, folder, make.name)
    script = build_script(config, arm, folder, make.name)
    return Stage(
        make,
        folder,
        arm,
        script,
        build_course(config, arm, script),
        config.device[0],
        Begun(),
        RADIUS_MM + arm.truth.radius_mm,
    )
