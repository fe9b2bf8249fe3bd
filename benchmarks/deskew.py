"""An arm that moves while its AMT21 encoders are asked one after the other.

The driver reads a simulated line in virtual time, so that nothing but the adapter's
delays decides when a joint is read; or, with --real-time, a pty. The daemon's assembler
brings the readings to common instants, and its pipeline makes points of them; the truth
is the simulator's own physics at that instant. Beside the error as read and that after
interpolation stand that of an arm whose encoders are all latched at the instant, which
is what their 14 bits alone do, and the daemon's published estimate.
"""

import argparse
import multiprocessing
import tempfile
import threading
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.virtual_time import Cable, Straight, VirtualTime, lines_through, played
from daemon.assembly import Assembly
from daemon.clock import HostClock
from daemon.configuration import AssemblySection
from daemon.model import ArmModel, read_model
from daemon.pipeline import Pipeline
from daemon.poses import PoseBlock
from daemon.skew import SkewWatch
from drivers.amt21 import Amt21
from drivers.values import (
    STATUS_LATE,
    STATUS_MISSING,
    CountSamples,
    Delivery,
    DeviceUp,
    StreamStarted,
)
from simulator.climate import ClimateTable
from simulator.clock import MonotonicClock
from simulator.config import SimulatorConfig
from simulator.course import Course
from simulator.devices.amt21 import Amt21Line, Amt21Table
from simulator.devices.device import Mounting
from simulator.faults import fault_from_table
from simulator.pacing import live_real
from simulator.script import Script
from simulator.trajectory import Trajectory, spline_pieces
from simulator.truth_log import TruthLog
from simulator.virtual_arm import build_arm
from simulator.wiring import ScriptClock, ScriptedCounts

ARM = Path(__file__).parent.parent / "traverse" / "demo_data" / "arm.toml"
ADDRESSES = (0x54, 0x58, 0x5C, 0x60, 0x64, 0x68, 0x6C)
KNOT_S = 0.02
SETTLED_S = 0.3  # what was before is not judged
FIRST_NS = 10**12

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Case:
    """An adapter and a motion.

    Attributes:
        exchange_s: what a request and its reply take.
        jitter_s: by how much replies come late at random, one in two.
        rate_hz: of the stream.
        sway_hz: of a joint's swing at 1 rad/s; 0 for a steady 1 rad/s.
    """

    exchange_s: float
    jitter_s: float
    rate_hz: float
    sway_hz: float


@dataclass(frozen=True, slots=True)
class Errors:
    """Of points, by the way that their counts were taken (`WAYS`).

    Attributes:
        rms_mm: root mean square; ``largest_mm``: the largest.
        published_mm: the daemon's estimate, the largest.
        n: points that carry no flag of a missing or late reading.
    """

    rate_hz: float
    rms_mm: dict[str, float]
    largest_mm: dict[str, float]
    published_mm: float
    n: int


WAYS = ("as read", "interpolated", "latched")
CASES = tuple(
    Case(exchange_s, jitter_s, rate_hz, sway_hz)
    for exchange_s, jitter_s in ((0.0002, 0.00005), (0.0005, 0.0002), (0.001, 0.0004))
    for rate_hz in (100.0,)
    for sway_hz in (0.0, 0.5, 2.0)
)


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
    """The arm on its way, seven encoders on it, and the daemon's picture of it."""

    course: Course
    model: ArmModel
    mounting: Mounting
    table: Amt21Table


def moving(folder: Path, case: Case, seconds: float) -> Moving:
    """An arm that moves from time 0 of the simulation on."""
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
    mounting = Mounting(
        folder,
        arm.encoders[0],
        ScriptedCounts(course, arm.encoders[0]),
        script,
        clock,
        (fault_from_table(late),),
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
    """What the driver delivers, and monotonic time 0 of the simulation."""
    now = VirtualTime(seconds)
    cable = Cable(now)
    with lines_through([cable]):
        now.devices.append(Amt21Line(arm.table, arm.mounting))
    straight = Straight(now.over)
    driver = Amt21(
        "base",
        straight,
        port="line",
        addresses=ADDRESSES,
        monotonic_ns=now.monotonic_ns,
        wait_for=now.wait_for,
        open_port=cable.open_port,
    )
    driver.request_stream(case.rate_hz)
    played(driver, now.over)
    return straight.all, FIRST_NS


def read_really(arm: Moving, case: Case, seconds: float) -> tuple[list[Delivery], int]:
    """The same through a pty, the encoders in a process of their own."""
    clock = MonotonicClock()
    line = Amt21Line(arm.table, arm.mounting)
    fork = multiprocessing.get_context("fork")
    life = fork.Process(
        target=live_real,
        args=([line], clock, arm.mounting.clock, None, lambda: False),
        daemon=True,
    )
    life.start()
    over = threading.Event()
    straight = Straight(over)
    port = str(arm.mounting.folder / "line")
    driver = Amt21("base", straight, port=port, addresses=ADDRESSES)
    driver.request_stream(case.rate_hz)
    with driver:
        over.wait(seconds)
        over.set()
    life.terminate()
    life.join()
    line.close()
    return straight.all, clock.origin_ns


def errors(arm: Moving, deliveries: list[Delivery], first_ns: int) -> Errors:
    """How far points are off, as the daemon would make them."""
    assembly = Assembly(arm.model, AssemblySection())
    skew = SkewWatch(limit_mm=1.0)
    ways = {name: Pipeline(arm.model, HostClock()) for name in WAYS}
    off_mm: dict[str, list[Floats]] = {name: [] for name in WAYS}
    rate_hz = 0.0

    def judge(name: str, samples: CountSamples) -> PoseBlock:
        poses = ways[name].poses(samples)
        at_s = (samples.sample_time_ns - first_ns) * 1e-9
        true_mm, _ = arm.course.probe(at_s)
        doubtful = (samples.status & (STATUS_MISSING | STATUS_LATE)) != 0
        settled = (at_s > SETTLED_S) & ~doubtful.any(axis=1)
        off_mm[name].append(np.linalg.norm(poses.xyz_mm - true_mm, axis=1)[settled])
        return poses

    for delivery in deliveries:
        match delivery:
            case DeviceUp():
                assembly.up("base", delivery.identity.jitter_ns, restarted=False)
            case StreamStarted():
                rate_hz = delivery.rate_hz
                assembly.stream("base", rate_hz)
            case CountSamples():
                judge("as read", replace(delivery, skew_ns=None))
                assembly.add(delivery, delivery.received_ns)
                for made in assembly.assembled(delivery.received_ns):
                    poses = judge("interpolated", made.samples)
                    skew.mark_block(arm.model, poses, made.doubts_counts)
                    at_s = (made.samples.sample_time_ns - first_ns) * 1e-9
                    readings_rad = arm.course.readings_rad(at_s)
                    noise = np.random.default_rng(0)
                    counts = arm.mounting.encoders.counts(readings_rad, noise)
                    counts = counts.astype(np.uint32)
                    judge(
                        "latched", replace(made.samples, counts=counts, fractions=None)
                    )
    all_mm = {name: np.concatenate(off_mm[name]) for name in WAYS}
    return Errors(
        rate_hz,
        {name: float(np.sqrt(np.mean(mm**2))) for name, mm in all_mm.items()},
        {name: float(mm.max()) for name, mm in all_mm.items()},
        skew.taken_mm() or 0.0,
        len(all_mm["interpolated"]),
    )


def measured(case: Case, seconds: float, *, real_time: bool = False) -> Errors:
    """Errors of one case."""
    with tempfile.TemporaryDirectory() as name:
        arm = moving(Path(name), case, seconds + 5.0 * real_time)
        read = read_really if real_time else read_virtually
        return errors(arm, *read(arm, case, seconds))


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=4.0)
    parser.add_argument("--real-time", action="store_true", help="over a pty, one case")
    options = parser.parse_args()
    cases = CASES[3:6] if options.real_time else CASES
    print("error of points in mm: root mean square, largest; 7 joints at 1 rad/s")
    print(
        "exchange  rate    motion        as read        interpolated   "
        "latched at once  estimate  points"
    )
    for case in cases:
        found = measured(case, options.seconds, real_time=options.real_time)
        motion = f"{case.sway_hz:g} Hz sway" if case.sway_hz else "steady"
        shown = "  ".join(
            f"{found.rms_mm[name]:6.3f} {found.largest_mm[name]:6.3f}" for name in WAYS
        )
        print(
            f"{case.exchange_s * 1e3:5.1f} ms  {found.rate_hz:4.0f} Hz  {motion:10s}  "
            f"{shown}  {found.published_mm:6.3f}  {found.n:6d}",
            flush=True,
        )


if __name__ == "__main__":
    main()
