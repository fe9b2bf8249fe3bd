"""An arm with effects touches a ball; a daemon with them and one without measure it."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import timedelta
from pathlib import Path
from typing import Any

import numpy as np

from tests.daemon.values import configuration, kept_at_once
from tests.end_to_end.measurement.virtual_time import Straight, VirtualBoard, played
from tests.established import identify
from tests.simulator.campaigns.arms import coupled
from tests.simulator.effects.examples import START, heavy_arm
from traverse.daemon.acquisition.device import Device
from traverse.daemon.clock import HostClock
from traverse.daemon.config.schema import UncertaintySection
from traverse.daemon.measurement import Measurement, Sinks
from traverse.daemon.monitoring.events import EventLog
from traverse.daemon.pose.arm_model import ArmModel, read_model
from traverse.drivers.base.values import Delivery, DeviceUp
from traverse.kinematics.arm_file.arm import Arm, Effect, Identification, write_arm
from traverse.protocol.messages import Point

RATE_HZ = 100.0  # of the tracking stream that the daemon runs by itself
COUNTS_PER_TURN = 2**28
WARM_C = 27.5
N_POINTS = 4

SIMULATION = f"""\
schema = "traverse/simulator/1"
seed = 7
start = "first_start"
start_utc = {START.isoformat()}
[arm]
file = "true.toml"
noise_rad = {{noise_rad}}
[climate]
temperature_c = {WARM_C}
[operator]
move_s = 0.15
approach_s = 0.2
dwell_s = 0.02
switch_speed_mm_s = 40.0
[[device]]
id = "base"
port = "board.pty"
temperatures_c = [{WARM_C}]
[[motion]]
kind = "sphere"
centre_mm = [500.0, 100.0, 50.0]
radius_mm = 30.0
points = {N_POINTS}
"""


@dataclass(frozen=True)
class Measured:
    """Points of both daemons, and the truth at each.

    Attributes:
        arm: With the effects.
        truth: Lines of the truth log, one a point.
        points: Of the daemon whose arm file has the effects.
        bare: Of the one whose arm file has none.
        board: That was measured with.
        model: Of the first daemon.
    """

    arm: Arm
    truth: list[dict[str, Any]]
    points: list[Point]
    bare: list[Point]
    board: VirtualBoard
    model: ArmModel

    @property
    def true_mm(self) -> np.ndarray:
        return np.array([line["centre_mm"] for line in self.truth])

    @property
    def misses_mm(self) -> np.ndarray:
        """With the effects in the daemon's file, (n, 3)."""
        return places_mm(self.points) - self.true_mm

    @property
    def bare_misses_mm(self) -> np.ndarray:
        return places_mm(self.bare) - self.true_mm

    @property
    def script_s(self) -> np.ndarray:
        """When the points were touched, (n,)."""
        return np.array([line["script_s"] for line in self.truth])


def places_mm(points: list[Point]) -> np.ndarray:
    return np.array([point.xyz_mm for point in points])


def fine_arm(*effects: Effect) -> Arm:
    """The heavy arm with a switching probe and encoders that resolve everything."""
    arm = heavy_arm()
    fine = {"counts_per_turn": COUNTS_PER_TURN}
    joints = tuple(
        joint.model_copy(update={"encoder": joint.encoder.model_copy(update=fine)})
        for joint in arm.joints
    )
    changes = {
        "joints": joints,
        "probe": arm.probe.model_copy(update={"kind": "switching"}),
        "effects": effects,
        # Drifts are believed from their epoch to here.
        "identification": Identification(date=START + timedelta(hours=1)),
    }
    return arm.model_copy(update=changes)


class Daemon:
    """The daemon's measuring path, without broker and event loop.

    Args:
        arm_file: that it measures with.
        clock: the host's.
        uncertainty: States covariances.
    """

    def __init__(
        self,
        arm_file: Path,
        clock: HostClock,
        uncertainty: UncertaintySection | None = None,
    ) -> None:
        self.points: list[Point] = []
        self.model = read_model(arm_file, {"base": None})
        configured = configuration(
            "base",
            inputs={"base/1": "switch"},
            uncertainty=uncertainty or UncertaintySection(),
        )
        self._device = Device(
            configured.device[0], Straight(lambda delivery: None), None
        )
        events = EventLog(clock, lambda event: None)
        self._measurement = Measurement(
            configured,
            self.model,
            Sinks(events, kept_at_once(self._keep)),
            clock,
            devices=[self._device],
        )

    def take(self, driver, delivery: Delivery) -> None:
        self._device.driver = driver
        self._measurement.dispatch(self._device, delivery)
        if isinstance(delivery, DeviceUp):  # the turns are those of the base posture
            self._measurement.references.confirm()

    def use_model(self, model: ArmModel) -> None:
        self._measurement.pipeline.use_model(model)

    def _keep(self, point: Point) -> bool:
        self.points.append(point)
        return True


def measured(
    folder: Path,
    monkeypatch,
    *effects: Effect,
    noise_rad: float = 0.0,
    couplings: Mapping[str, tuple[str, float]] | None = None,
) -> Measured:
    arm = coupled(fine_arm(*effects), **(couplings or {}))
    write_arm(folder / "true.toml", arm)
    write_arm(folder / "bare.toml", arm.model_copy(update={"effects": ()}))
    identify(folder / "true.toml")
    identify(folder / "bare.toml")
    text = SIMULATION.format(noise_rad=noise_rad)
    (folder / "simulator.toml").write_text(text, "utf-8")
    board = VirtualBoard(folder)
    early: list[tuple[Any, Delivery]] = []
    daemons: list[Daemon] = []

    def take(driver, delivery: Delivery) -> None:
        if not board.is_begun:
            early.append((driver, delivery))
            return
        # Only now does the board's clock know the date: to daemons that had begun
        # before the host's clock would have been set.
        if not daemons:
            for name in ("true.toml", "bare.toml"):
                daemons.append(Daemon(folder / name, board.clock))
                for waiting in early:
                    daemons[-1].take(*waiting)
        for daemon in daemons:
            daemon.take(driver, delivery)

    played(board, monkeypatch, RATE_HZ, take)
    adapted, bare = daemons
    lines = (folder / "truth.jsonl").read_text("utf-8").splitlines()
    edges = [json.loads(line) for line in lines]
    truth = [edge for edge in edges if edge["input_name"] == "switch" and edge["level"]]
    assert len(truth) == len(adapted.points) == len(bare.points) == N_POINTS
    return Measured(arm, truth, adapted.points, bare.points, board, adapted.model)
