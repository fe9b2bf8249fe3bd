"""The simulated arm of `bar` with the encoders of each driver."""

import multiprocessing
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from traverse.arrays import Floats
from traverse.drivers.base.driver import Driver
from traverse.drivers.base.registry import driver_class
from traverse.drivers.polling.polled_driver import PolledDriver
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
from traverse.simulator.scenario.truth_log import TruthLog
from traverse.simulator.scenario.wiring import ScriptedCounts
from traverse.simulator.virtual_arm import (
    VirtualArm,
    build_arm,
    build_course,
    build_script,
)

ARM = Path(__file__).parent.parent.parent / "cli" / "demo_data" / "arm.toml"
N_JOINTS = 7
ADAPTER = {"request_delay_s": 0.00015, "reply_delay_s": 0.00035}
NODES = tuple(range(1, N_JOINTS + 1))
ADDRESSES = tuple(range(0x54, 0x54 + 4 * N_JOINTS, 4))
PORTS = tuple(f"rls-{number}" for number in range(N_JOINTS))
DeliveryQueue = Any


@dataclass(frozen=True, slots=True)
class Make:
    """Encoders of one make.

    Attributes:
        name: of the driver; it is the device's id too.
        table: of the simulated device, besides kind and id.
        options: of the driver; ports are relative to a folder.
        asked_hz: fastest stream that is requested.
        latches: all encoders at one instant of its own, so that real time does as
            well as virtual time.
    """

    name: str
    bits: int
    line: str
    table: Mapping[str, Any]
    options: Mapping[str, Any]
    asked_hz: float = 1000.0
    latches: bool = False

    @property
    def is_polled(self) -> bool:
        return issubclass(driver_class(self.name), PolledDriver)

    def arm_text(self) -> str:
        text = ARM.read_text("utf-8")
        for counts in ("8388608", "4194304"):
            text = text.replace(counts, str(1 << self.bits))
        return text.replace('"base/', f'"{self.name}/')

    @property
    def is_on_a_bus(self) -> bool:
        """Whether it has no port but a bus in the memory of one process."""
        return "channel" in self.table

    @property
    def lines(self) -> tuple[str, ...]:
        ports: tuple[str, ...] = self.table.get("ports", (self.table.get("port"),))
        return ports

    def driver(
        self, delivery_queue: DeliveryQueue, folder: Path, **services: object
    ) -> Driver:
        options = dict(self.options)
        if "port" in options:
            options["port"] = str(folder / options["port"])
        if "ports" in options:
            options["ports"] = tuple(str(folder / port) for port in options["ports"])
        make: Callable[..., Driver] = driver_class(self.name)
        valid = driver_class(self.name).options_class(**options)
        return make(self.name, valid, delivery_queue, **services)


MAKES = (
    Make(
        "latch-board",
        23,
        "USB-CDC",
        {"port": "board", "encoder_turns": 1},
        {"port": "board"},
        latches=True,
    ),
    Make(
        "canopen",
        18,
        "CAN in memory",
        {"interface": "virtual", "channel": "bar", "nodes": NODES},
        {"interface": "virtual", "channel": "bar", "nodes": NODES},
        latches=True,
        asked_hz=25.0,  # enough for an arm at rest, however busy the computer is
    ),
    Make(
        "amt21",
        14,
        "RS-485 2 Mbit/s, USB 0.5 ms",
        {"port": "amt21", "addresses": ADDRESSES, "baud_rate": 2_000_000, **ADAPTER},
        {"port": "amt21", "addresses": ADDRESSES},
    ),
    Make(
        "rls",
        18,
        "7 x 115200 bit/s, USB 0.5 ms",
        {"ports": PORTS, "bits": 18, "baud_rate": 115_200, **ADAPTER},
        {"ports": PORTS, "bits": 18},
    ),
    Make(
        "modbus",
        16,
        "RS-485 115200 bit/s, USB 0.5 ms",
        {
            "port": "modbus",
            "addresses": NODES,
            "baud_rate": 115_200,
            "parity": "none",
            **ADAPTER,
        },
        {
            "port": "modbus",
            "encoders": tuple({"address": n, "counts_per_turn": 65536} for n in NODES),
            "baud_rate": 115_200,
            "parity": "none",
        },
    ),
    Make(
        "microscribe",
        14,
        "115200 bit/s, USB 0.5 ms",
        {
            "port": "microscribe",
            "hci": 3,
            "pedals": ("button",),
            "home": (0,) * 6,
            "geometry": {"alpha": (0,) * 6, "a": (0,) * 6, "d": (0,) * 6},
            "baud_rate": 115_200,
            **ADAPTER,
        },
        {"port": "microscribe"},
    ),
)
BY_NAME = {make.name: make for make in MAKES}


STEP_RAD = 1e-6
DISTANCE_MM, RADIUS_MM = 500.0, 25.4  # of the bar and its spheres
OPERATOR = {"move_s": 1.0, "approach_s": 0.2, "dwell_s": 0.4, "press_s": 0.1}


class Begun:
    """A `ScriptClock` that another process starts."""

    def __init__(self) -> None:
        fork = multiprocessing.get_context("fork")
        self._begin_s = fork.Value("d", -1.0)
        self._ended = fork.Event()

    @property
    def begin_s(self) -> float | None:
        """Start in simulation time [s]; None until it is set."""
        return None if self._begin_s.value < 0.0 else self._begin_s.value

    def set(self, time_s: float) -> None:
        self._begin_s.value = time_s

    def end(self) -> None:
        self._ended.set()

    def is_over(self) -> bool:
        return self._ended.is_set() or os.getppid() == 1

    def begin(self, time_s: float) -> None:
        del time_s

    def script_s(self, time_s: float) -> float:
        begin_s = self.begin_s
        return 0.0 if begin_s is None else max(0.0, time_s - begin_s)


@dataclass(frozen=True, slots=True)
class Stage:
    """The arm, its motion, and its devices.

    Attributes:
        touched_mm: distance between the centres of the ball and the touched sphere.
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
        return np.array([e.time_s for e in self.script.events if e.level])

    def presses_ns(self, origin_ns: int) -> list[int]:
        """Return presses on the host's clock, which showed ``origin_ns`` at time 0."""
        begun_s = self.begun.begin_s + self.presses_s
        return [origin_ns + round(1e9 * at_s) for at_s in begun_s.tolist()]

    def jacobians_mm(self) -> Floats:
        """Return the ball's motion by each joint at the presses, (n, 3, n_joints).

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
        device = self.device()
        end_s = self.script.duration_s
        live_real([device], clock, self.begun, end_s, self.begun.is_over)
        device.close()


def staged(make: Make, points: int, folder: Path) -> Stage:
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
