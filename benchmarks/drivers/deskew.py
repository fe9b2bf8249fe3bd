"""An arm that moves while its AMT21 encoders are polled one after the other.

The daemon's assembler interpolates readings to common instants, its pipeline makes
points of them; the truth is the simulator's own physics at that instant. Printed are
the error as read, that after interpolation, that of an arm whose encoders are all
latched at the instant (their 14 bits alone), and the daemon's published estimate.
"""

import argparse
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.drivers.moving_arm import (
    Case,
    Moving,
    moving,
    read_really,
    read_virtually,
)
from benchmarks.tools.sizes import sized
from traverse.arrays import Floats
from traverse.daemon.acquisition.resampler import Resampler
from traverse.daemon.clock import HostClock
from traverse.daemon.config.schema import AssemblySection
from traverse.daemon.pose.pipeline import Pipeline
from traverse.daemon.pose.poses import PoseBlock
from traverse.daemon.pose.uncertainty import SkewMonitor
from traverse.drivers.base.values import (
    STATUS_LATE,
    STATUS_MISSING,
    CountSamples,
    Delivery,
    DeviceUp,
    StreamStarted,
)

SETTLED_S = 0.3  # what was before is not judged


@dataclass(frozen=True, slots=True)
class Errors:
    """Errors of points, by the source of their counts (`WAYS`).

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


def errors(arm: Moving, deliveries: list[Delivery], first_ns: int) -> Errors:
    """How far points are off, as the daemon would make them."""
    assembly = Resampler(arm.model, AssemblySection())
    skew = SkewMonitor(limit_mm=1.0)
    ways = {name: Pipeline(arm.model, HostClock()) for name in WAYS}
    off_mm: dict[str, list[Floats]] = {name: [] for name in WAYS}
    rate_hz = 0.0

    def judge(name: str, samples: CountSamples) -> PoseBlock:
        poses = ways[name].poses(samples)
        at_s = np.float64(1e-9) * (samples.sample_time_ns - first_ns)
        true_mm, _ = arm.course.probe(at_s)
        doubtful = (samples.status & (STATUS_MISSING | STATUS_LATE)) != 0
        settled = (at_s > SETTLED_S) & ~doubtful.any(axis=1)
        off_mm[name].append(np.linalg.norm(poses.xyz_mm - true_mm, axis=1)[settled])
        return poses

    for delivery in deliveries:
        match delivery:
            case DeviceUp():
                assembly.on_up("base", delivery.identity, restarted=False)
            case StreamStarted():
                rate_hz = delivery.rate_hz
                assembly.set_rate("base", rate_hz)
            case CountSamples():
                judge("as read", replace(delivery, skew_ns=None))
                assembly.add(delivery, delivery.received_ns)
                for block, bounds in assembly.resampled(delivery.received_ns):
                    poses = judge("interpolated", block)
                    skew.flag_block(arm.model, poses, bounds)
                    made_s = np.float64(1e-9) * (block.sample_time_ns - first_ns)
                    readings_rad = arm.course.readings_rad(made_s)
                    noise = np.random.default_rng(0)
                    counts = arm.mounting.encoders.counts(readings_rad, noise)
                    latched = replace(
                        block, counts=counts.astype(np.uint32), fractions=None
                    )
                    judge("latched", latched)
    all_mm = {name: np.concatenate(off_mm[name]) for name in WAYS}
    return Errors(
        rate_hz,
        {name: float(np.sqrt(np.mean(mm**2))) for name, mm in all_mm.items()},
        {name: float(mm.max()) for name, mm in all_mm.items()},
        skew.pop_largest_mm() or 0.0,
        len(all_mm["interpolated"]),
    )


def measured(case: Case, seconds: float, *, real_time: bool = False) -> Errors:
    with tempfile.TemporaryDirectory() as name:
        arm = moving(Path(name), case, seconds + 5.0 * real_time)
        read = read_really if real_time else read_virtually
        return errors(arm, *read(arm, case, seconds))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=sized(4.0, 1.0))
    parser.add_argument("--real-time", action="store_true", help="over a pty, one case")
    options = parser.parse_args()
    cases = CASES[3:6] if options.real_time else sized(CASES, CASES[:1])
    print("error of points in mm: root mean square, largest; 7 joints at 1 rad/s")
    print(
        "exchange  rate    motion        as read        interpolated   "
        "latched at once  estimate  points"
    )
    for case in cases:
        result = measured(case, options.seconds, real_time=options.real_time)
        motion = f"{case.sway_hz:g} Hz sway" if case.sway_hz else "steady"
        shown = "  ".join(
            f"{result.rms_mm[name]:6.3f} {result.largest_mm[name]:6.3f}"
            for name in WAYS
        )
        print(
            f"{case.exchange_s * 1e3:5.1f} ms  {result.rate_hz:4.0f} Hz  {motion:10s}  "
            f"{shown}  {result.published_mm:6.3f}  {result.n:6d}",
            flush=True,
        )


if __name__ == "__main__":
    main()
