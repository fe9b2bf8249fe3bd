"""Length of one ball bar by every driver.

A simulated arm touches the two spheres of a bar of 500 mm, in the same motion for all
makes of encoders; each rounds to its own counts, at its own instants, over its own
line. The daemon's assembler and pipeline make points of the deliveries; two spheres of
the known radius are fitted to them. The deviation of the length is printed with the
deviation expected from rounding alone.
"""

import argparse
import contextlib
import multiprocessing
import tempfile
import threading
from contextlib import nullcontext
from dataclasses import dataclass
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

from benchmarks.drivers.bar_devices import BY_NAME, DISTANCE_MM, Make, Stage, staged
from benchmarks.tools.sizes import sized
from benchmarks.tools.virtual_time import (
    FIRST_NS,
    Cable,
    HostEnd,
    VirtualTime,
    lines_through,
    played,
)
from traverse.arrays import Floats
from traverse.daemon.acquisition.resampler import Resampler
from traverse.daemon.clock import HostClock
from traverse.daemon.config.schema import AssemblySection
from traverse.daemon.pose.arm_model import ArmModel, read_model
from traverse.daemon.pose.pipeline import Pipeline
from traverse.daemon.pose.poses import JointCounts
from traverse.drivers.base.delivery_queue import BATCH_WINDOW_NS
from traverse.drivers.base.driver import Driver
from traverse.drivers.base.values import (
    STATUS_MISSING,
    CountSamples,
    Delivery,
    DeviceUp,
    LatchedCounts,
    StreamStarted,
)
from traverse.drivers.io.ports import PortAccess
from traverse.kinematics.fits import fit_sphere_of_radius
from traverse.simulator.pacing import MonotonicClock

UP_S = 20.0  # until a device has been found
LEAD_S = 0.3  # from there to the begin of the motion
VIRTUAL_LEAD_S = 2.0
TINY_NAMES = tuple(BY_NAME)[:2]


class Taker:
    """Requests a stream and takes the driver's deliveries, in the driver's thread."""

    dropped_samples = dropped_others = 0
    max_samples = 1 << 20
    batch_window_ns = BATCH_WINDOW_NS
    together = contextlib.nullcontext

    def __init__(self, asked_hz: float, over: threading.Event) -> None:
        self.all: list[Delivery] = []
        self.up = threading.Event()
        self.driver: Driver | None = None
        self._asked_hz = asked_hz
        self._over = over

    def put(self, delivery: Delivery, *, wakes: bool = True) -> bool:
        if self._over.is_set():
            return True
        self.all.append(delivery)
        if isinstance(delivery, DeviceUp) and self.driver is not None:
            fastest_hz = delivery.identity.max_rate_hz
            self.driver.request_stream(min(self._asked_hz, fastest_hz))
            self.up.set()
        if isinstance(delivery, LatchedCounts) and self.driver is not None:
            self.driver.acknowledge(delivery.token)
        return True

    def wake(self) -> None:
        """Do nothing: deliveries are taken as they are put."""


@dataclass(frozen=True, slots=True)
class Measured:
    """Result of a driver.

    Attributes:
        rounding_mm: standard deviation of the length by rounding.
        noise_mm: the same of a point, all directions together.
        skew_us: from the first to the last reading of a sample, median.
    """

    off_mm: float
    rounding_mm: float
    noise_mm: float
    rate_hz: float
    skew_us: float


def measured_really(make: Make, points: int, folder: Path) -> Measured:
    """Read in real time, the device in a process of its own if it has a port.

    Raises:
        TimeoutError: The device is not found.
    """
    stage, clock = staged(make, points, folder), MonotonicClock()
    taker = Taker(make.asked_hz, threading.Event())
    life: threading.Thread | BaseProcess
    if make.is_on_a_bus:
        life = threading.Thread(target=stage.live, args=(clock,), daemon=True)
    else:
        fork = multiprocessing.get_context("fork")
        life = fork.Process(target=stage.live, args=(clock,), daemon=True)
    life.start()
    try:
        taker.driver = make.driver(taker, folder)
        with taker.driver:
            if not taker.up.wait(UP_S):
                raise TimeoutError(f"{make.name} is not found: {taker.all}")
            stage.begun.set(clock.now_s() + LEAD_S)
            life.join(stage.script.duration_s + UP_S)
    finally:
        stage.begun.end()
        life.join()
    return judged(stage, taker.all, clock.origin_ns)


def measured_virtually(
    make: Make, points: int, folder: Path, asked_hz: float = 1e6
) -> Measured:
    """Read in virtual time, through cables in memory; not for buses.

    A controller board must not be requested to stream above 400 Hz: above, its driver
    gathers bytes in real time.
    """
    stage = staged(make, points, folder)
    now = VirtualTime(VIRTUAL_LEAD_S + stage.script.duration_s)
    cables = {str(folder / line): Cable(now) for line in make.lines}
    stage.begun.set(VIRTUAL_LEAD_S)
    with lines_through(list(cables.values())):
        device: Any = stage.device()
    now.devices = [device]

    def open_port(path: str, *arguments: object, **options: object) -> HostEnd:
        del arguments, options
        return HostEnd(cables[path].held_by_host(), path)

    services: dict[str, Any] = {"monotonic_ns": now.monotonic_ns}
    if make.is_polled:
        services["ports"] = PortAccess(open_port, now.wait_for_any)
    taker = Taker(min(make.asked_hz, asked_hz), now.over)
    taker.driver = make.driver(taker, folder, **services)
    patched = f"{type(taker.driver).__module__}.SerialPort"
    with nullcontext() if make.is_polled else patch(patched, open_port):
        played(taker.driver, now.over)
    return judged(stage, taker.all, FIRST_NS)


def judged(stage: Stage, deliveries: list[Delivery], origin_ns: int) -> Measured:
    model = read_model(stage.folder / "arm.toml", {stage.make.name: None})
    balls_mm = points_of(model, stage, deliveries, origin_ns)
    centres_mm = _centres_mm(balls_mm, stage.touched_mm)
    rounding_mm, noise_mm = rounding(model, stage, balls_mm, centres_mm)
    blocks = [delivery for delivery in deliveries if isinstance(delivery, CountSamples)]
    times_s = np.concatenate([b.sample_time_ns for b in blocks]) * 1e-9
    skews = [np.ptp(b.skew_ns, axis=1) for b in blocks if b.skew_ns is not None]
    return Measured(
        float(np.linalg.norm(centres_mm[1] - centres_mm[0])) - DISTANCE_MM,
        rounding_mm,
        noise_mm,
        (len(times_s) - 1) / float(times_s[-1] - times_s[0]),
        1e-3 * float(np.median(np.concatenate(skews))) if skews else 0.0,
    )


def points_of(
    model: ArmModel, stage: Stage, deliveries: list[Delivery], origin_ns: int
) -> Floats:
    """Ball centres (n, 3) at the presses of the button.

    At edges that the device itself latched with its counts, else out of its stream.

    Raises:
        RuntimeError: Readings are missing around a press.
    """
    device = stage.make.name
    assembly = Resampler(model, AssemblySection())
    pipeline = Pipeline(model, HostClock())
    edges: list[tuple[int, LatchedCounts | None]] = [
        (delivered.sample_time_ns, delivered)
        for delivered in deliveries
        if isinstance(delivered, LatchedCounts)
        and delivered.active
        and delivered.counts
    ]
    edges = edges or [(press_ns, None) for press_ns in stage.presses_ns(origin_ns)]
    joints: list[JointCounts] = []
    for delivery in deliveries:
        match delivery:
            case DeviceUp():
                assembly.on_up(device, delivery.identity, restarted=False)
            case StreamStarted():
                assembly.set_rate(device, delivery.rate_hz)
            case CountSamples():
                assembly.record(delivery)
        while len(joints) < len(edges) and (
            joint_samples := assembly.at(*edges[len(joints)])
        ):
            joints.append(joint_samples)
    n_whole = sum(not (counts.status & STATUS_MISSING).any() for counts in joints)
    if n_whole < len(stage.presses_s):
        raise RuntimeError(
            f"{device}: {n_whole} points of {len(stage.presses_s)}; is the computer "
            "busy with something else?"
        )
    return np.array([pipeline.pose_at(counts).xyz_mm for counts in joints])


def _centres_mm(balls_mm: Floats, touched_mm: float) -> list[Floats]:
    return [
        np.asarray(fit_sphere_of_radius(half, touched_mm).centre_mm)
        for half in np.split(balls_mm, 2)
    ]


def rounding(
    model: ArmModel, stage: Stage, balls_mm: Floats, centres_mm: list[Floats]
) -> tuple[float, float]:
    """Standard deviations that rounding makes: of the length, and of a point.

    A count is off by a variance of 1/12; a centre follows its points by the
    pseudo-inverse of the surface's normals.
    """
    steps_rad = np.abs(model.per_count_rad) / np.sqrt(12.0)
    moved_mm = stage.jacobians_mm() * steps_rad
    along = (centres_mm[1] - centres_mm[0]) / DISTANCE_MM
    variance_mm2 = 0.0
    for half, moved, centre_mm in zip(
        np.split(balls_mm, 2), np.split(moved_mm, 2), centres_mm, strict=True
    ):
        normals = (half - centre_mm) / stage.touched_mm
        weights = along @ np.linalg.pinv(normals)
        across = np.einsum("ni,nij->nj", normals, moved)
        variance_mm2 += float(np.sum((weights[:, np.newaxis] * across) ** 2))
    noise_mm = np.sqrt(np.mean(np.sum(moved_mm**2, axis=(1, 2))))
    return float(np.sqrt(variance_mm2)), float(noise_mm)


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.drivers.bar")
    parser.add_argument("names", nargs="*", help="of drivers; all if none is given")
    parser.add_argument(
        "--points", type=int, default=sized(10, 5), help="on each sphere"
    )
    parser.add_argument("--real", action="store_true", help="all in real time")
    arguments = parser.parse_args()
    print(f"ball bar of 500 mm, {arguments.points} points on each sphere, seven joints")
    print("| driver | line | bits | rate | skew of a sample | point noise |", end="")
    print(" length off | expected of rounding |\n|---|---|---|---|---|---|---|---|")
    for make in [
        BY_NAME[name] for name in arguments.names or sized(tuple(BY_NAME), TINY_NAMES)
    ]:
        really = make.latches or arguments.real
        measured = measured_really if really else measured_virtually
        try:
            with tempfile.TemporaryDirectory() as name:
                row = measured(make, arguments.points, Path(name))
        except (RuntimeError, TimeoutError) as error:
            print(f"| `{make.name}` | {make.line} | not measured: {error} |")
            continue
        print(
            f"| `{make.name}` | {make.line} | {make.bits} | {row.rate_hz:.0f} Hz | "
            f"{row.skew_us:.0f} µs | {1e3 * row.noise_mm:.3g} µm | "
            f"{1e3 * row.off_mm:+.3g} µm | {1e3 * row.rounding_mm:.3g} µm |",
            flush=True,
        )


if __name__ == "__main__":
    main()
