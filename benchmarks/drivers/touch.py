"""`python -m benchmarks.drivers.touch`: three ways to place a probe at its contact.

One run of simulator, broker and daemon: the ball approaches a sphere at 50 mm/s, and at
each contact

    latched        is the daemon's point, of the counts latched at the edge
    interpolated   is the daemon's own interpolation of the stream at the edge's instant
    naive          is the last sample of the stream before the message arrived

each against the simulator's truth at the edge. The stream has 100 Hz, 1 kHz and so
on; the message arrives after the debounce time.
"""

import asyncio
import json
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from benchmarks.service.stream import ARM, order_scan, wait_until_subscribed
from benchmarks.tools import rig
from benchmarks.tools.command_line import run_main
from benchmarks.tools.sizes import sized
from traverse.arrays import Floats, Integers
from traverse.broker.address import BrokerAddress
from traverse.client.mqtt.connection import ConfiguredClient
from traverse.client.mqtt.subscription import received, subscribe
from traverse.daemon.acquisition.interpolation import (
    EncoderReadings,
    InterpolationLimits,
    interpolate,
)
from traverse.daemon.pose.arm_model import ArmModel, read_model
from traverse.kinematics.model.forward import probe_centre
from traverse.kinematics.model.readings import counts_to_angles
from traverse.protocol.messages import Point, Scan

SPEED_MM_S = 50.0
N_POINTS = sized(15, 3)
SIMULATION = """\
schema = "traverse/simulator/1"
seed = 5
repeat = true
truth_log = "truth.jsonl"
[arm]
file = "arm.toml"
[operator]
move_s = 0.15
approach_s = 0.3
dwell_s = 0.1
switch_speed_mm_s = {speed}
[[device]]
id = "base"
port = "board.pty"
[[motion]]
kind = "sphere"
centre_mm = [700.0, 100.0, 120.0]
radius_mm = 50.8
points = {points}
"""
SWITCH = '{ source = "base/1", trigger = "switch" }'


class Followed:
    """Received points and stream, with the times at which points arrived."""

    def __init__(self) -> None:
        self.points: list[Point] = []
        self.came_ns: list[int] = []
        self.times_ns: list[Integers] = []
        self.counts: list[Integers] = []
        self.xyz_mm: list[Floats] = []

    def add(self, message: object) -> None:
        if isinstance(message, Point) and self.times_ns:
            self.points.append(message)
            self.came_ns.append(time.time_ns())
        elif isinstance(message, Scan) and message.counts is not None:
            self.times_ns.append(message.time_ns + message.dtime_ns)
            self.counts.append(message.counts)
            self.xyz_mm.append(message.xyz_mm)

    def reaches(self) -> bool:
        return bool(self.times_ns) and self.times_ns[-1][-1] > self.came_ns[-1]


async def followed(port: int, rate_hz: float) -> Followed:
    """Scan until all points have arrived, and a little longer."""
    await wait_until_subscribed(port)
    followed_messages = Followed()
    async with ConfiguredClient(BrokerAddress("127.0.0.1", port)) as client:
        await subscribe(client, ARM, ("point", "scan"))
        await order_scan(client, "start", rate_hz)
        async for item in received(client):
            followed_messages.add(item.message)
            if (
                len(followed_messages.points) >= N_POINTS
                and followed_messages.reaches()
            ):
                break
        await order_scan(client, "stop", rate_hz)
    return followed_messages


def interpolated_mm(
    model: ArmModel, followed_messages: Followed, instants_ns: Integers
) -> Floats:
    """The daemon's interpolation of the stream at some instants, (n, 3)."""
    times_ns, first = np.unique(
        np.concatenate(followed_messages.times_ns), return_index=True
    )
    counts = np.concatenate(followed_messages.counts)[first]
    limits = InterpolationLimits(max_gap_ns=50_000_000, late_ns=0)
    columns = [
        interpolate(
            EncoderReadings(
                times_ns,
                column,
                np.zeros(len(column), np.uint8),
                np.arange(len(column)),
                np.zeros(len(column), np.int64),
            ),
            instants_ns,
            limits,
        )
        for column in counts.T
    ]
    interpolated = np.column_stack([column.counts for column in columns])
    angles_rad = counts_to_angles(model.encoders, interpolated)
    fractions = np.column_stack([column.fractions for column in columns])
    angles_rad += fractions * model.per_count_rad
    return np.asarray(probe_centre(model.geometry, angles_rad))


def figures(folder: Path, followed_messages: Followed) -> Iterator[str]:
    model = read_model(folder / "arm.toml", {"base": None})
    lines = (folder / "truth.jsonl").read_text("utf-8").splitlines()
    edges = [line for line in map(json.loads, lines) if line["event"] == "edge"]
    truth_mm = np.array([edge["centre_mm"] for edge in edges if edge["level"] == 1])
    # An edge and its point have the same counts, within whole turns.
    channels, turns = model.channels, model.encoders.counts_per_turn
    edge_counts = np.array([edge["counts"] for edge in edges if edge["level"] == 1])
    edge_counts = edge_counts[:, channels] % turns
    rows = [
        int(
            np.flatnonzero((edge_counts == np.array(point.counts) % turns).all(axis=1))[
                0
            ]
        )
        for point in followed_messages.points
    ]
    truth_mm = truth_mm[rows]
    times_ns = np.concatenate(followed_messages.times_ns)
    last = np.searchsorted(times_ns, followed_messages.came_ns, side="right") - 1
    instants_ns = np.array(
        [point.time_ns for point in followed_messages.points], np.int64
    )
    ways = {
        "latched": np.array([point.xyz_mm for point in followed_messages.points]),
        "interpolated": interpolated_mm(model, followed_messages, instants_ns),
        "naive": np.concatenate(followed_messages.xyz_mm)[last],
    }
    for name, xyz_mm in ways.items():
        errors_um = 1e3 * np.linalg.norm(xyz_mm - truth_mm, axis=1)
        yield (
            f"{name:13} rms {np.sqrt(np.mean(errors_um**2)):9.3f} um, "
            f"largest {errors_um.max():9.3f} um, {len(errors_um)} points"
        )


def run(folder: Path, rate_hz: float) -> list[str]:
    port = rig.free_port()
    arm = rig.ARM.read_text("utf-8").replace('kind = "hard"', 'kind = "switching"')
    (folder / "arm.toml").write_text(arm, "utf-8")
    text = SIMULATION.format(speed=SPEED_MM_S, points=N_POINTS)
    (folder / "simulator.toml").write_text(text)
    text = rig.DAEMON.format(folder=folder, port=port)
    text = text.replace('{ source = "base/0", trigger = "button" }', SWITCH)
    text = text.replace("debounce_us = 0\n", "")  # undebounced
    text = text.replace("[capture]\n", "[capture]\nscan_block_s = 0.01\n")
    (folder / "daemon.toml").write_text(text)
    traverse = (sys.executable, "-m", "traverse")
    simulate = (*traverse, "simulate", "devices", str(folder / "simulator.toml"))
    measure = (*traverse, "run", str(folder / "daemon.toml"))
    log = folder / "daemon.log"
    with (
        rig.mosquitto(folder, port),
        rig.program(folder / "simulator.log", *simulate),
    ):
        rig.wait_for((folder / "board.pty").exists, "the simulated board")
        with rig.program(log, *measure):
            rig.wait_for(lambda: b"arm demo-7" in log.read_bytes(), "the daemon")
            followed_messages = asyncio.run(followed(port, rate_hz))
    return list(figures(folder, followed_messages))


def main() -> None:
    for rate_hz in (100.0, 1000.0):
        with tempfile.TemporaryDirectory() as folder:
            print(f"contact at {SPEED_MM_S:g} mm/s, stream of {rate_hz:g} Hz")
            for line in run(Path(folder), rate_hz):
                print(f"  {line}", flush=True)


if __name__ == "__main__":
    run_main(main)
