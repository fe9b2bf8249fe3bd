"""`python -m benchmarks.service.filters`: cost of filters of points.

In the daemon: the share of a core with a stream of 10 kHz through all filters at once,
beside the same stream without any. Off-line: points per second of each filter alone and
of all together, on a path like that of a hand over a surface, in blocks as of a file.
"""

import asyncio
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.service.stream import ARM, order_scan, wait_until_subscribed
from benchmarks.tools import rig
from benchmarks.tools.command_line import run_main
from benchmarks.tools.sizes import sized
from traverse.broker.address import BrokerAddress
from traverse.client.mqtt.connection import ConfiguredClient
from traverse.client.mqtt.subscription import received, subscribe
from traverse.daemon.config.filters import FilterSection, filter_chain
from traverse.kinematics.filters import FilterChain, PointBlock
from traverse.protocol.messages import Health, Scan

if TYPE_CHECKING:
    import subprocess

RATE_HZ = 10_000.0
SECONDS = sized(10.0, 1.0)
N_POINTS = sized(10_000_000, 200_000)
N_BLOCK = 100_000
SILENCE_S = 60.0  # without any point: the filters let none through
N_JOINTS = 7
SPEED_MM_S = 100.0
FILTERS = """
[[scan.filters]]
kind = "box"
low_mm = [-2000, -2000, -2000]
high_mm = [2000, 2000, 2000]
[[scan.filters]]
kind = "sphere"
centre_mm = [700, 0, 100]
radius_mm = 500
[[scan.filters]]
kind = "slab"
normal = [0, 0, 1]
from_mm = -1000
to_mm = 1000
[[scan.filters]]
kind = "speed"
max_mm_s = 100000
[[scan.filters]]
kind = "quality"
allowed = [
    "interpolated", "geometry_unknown", "turns_uncertain", "identity_unconfirmed",
    "time_uncertain", "utc_uncertain",
]
[[scan.filters]]
kind = "distance"
spacing_mm = 0.02
[[scan.filters]]
kind = "grid"
spacing_mm = 0.05
[[scan.filters]]
kind = "spacing"
spacing_mm = 0.05
[[scan.filters]]
kind = "sections"
normal = [1, 0, 0]
spacing_mm = 0.5
"""
TABLES: tuple[dict[str, Any], ...] = (
    {"kind": "box", "low_mm": (-2e3, -2e3, -2e3), "high_mm": (2e3, 2e3, 2e3)},
    {"kind": "sphere", "centre_mm": (700.0, 0.0, 100.0), "radius_mm": 500.0},
    {"kind": "slab", "normal": (0.0, 0.0, 1.0), "from_mm": -1e3, "to_mm": 1e3},
    {"kind": "speed", "max_mm_s": 1e5},
    {"kind": "quality", "allowed": ("interpolated",)},
    {"kind": "distance", "spacing_mm": 0.1},
    {"kind": "grid", "spacing_mm": 0.5},
    {"kind": "spacing", "spacing_mm": 0.5},
    {"kind": "sections", "normal": (1.0, 0.0, 0.0), "spacing_mm": 1.0},
)


def blocks(n_points: int) -> Iterator[PointBlock]:
    """A path that sweeps over a surface, 100 mm/s at 10 kHz, block after block."""
    random = np.random.default_rng(1)
    noise_mm = random.normal(0.0, 0.003, (N_BLOCK, 3))
    ijk = np.tile([0.0, 0.0, 1.0], (N_BLOCK, 1))
    angles_rad = np.zeros((N_BLOCK, N_JOINTS))
    counts = np.zeros((N_BLOCK, N_JOINTS), np.int64)
    quality = np.zeros(N_BLOCK, np.uint32)
    covariance_mm2 = np.zeros((N_BLOCK, 6))
    for first in range(0, n_points, N_BLOCK):
        seq = np.arange(first, first + N_BLOCK)
        way_mm = seq * (SPEED_MM_S / RATE_HZ)
        # Lines of 200 mm, to and fro, half a millimetre apart.
        line, along_mm = np.divmod(way_mm, 200.0)
        x_mm = np.where(line % 2 == 0, along_mm, 200.0 - along_mm) + 600.0
        xyz_mm = np.column_stack([x_mm, line % 400 * 0.5 - 100.0, 0.01 * x_mm])
        xyz_mm += noise_mm
        times_ns = (seq * (1e9 / RATE_HZ)).astype(np.int64)
        places = seq, times_ns, xyz_mm, ijk
        yield PointBlock(*places, angles_rad, counts, quality, covariance_mm2)


def off_line(n_points: int) -> Iterator[str]:
    """Points per second of each filter, and of all together."""
    chains = [(str(table["kind"]), [table]) for table in TABLES]
    for name, tables in [*chains, ("all together", list(TABLES))]:
        chain = filter_chain(FilterSection.from_table(table) for table in tables)
        taken_s, n_kept = _taken_s(chain, n_points)
        yield (
            f"{name:13} {n_points / taken_s / 1e6:7.2f} million points/s, "
            f"{n_kept} of {n_points} passed"
        )


def _taken_s(chain: FilterChain, n_points: int) -> tuple[float, int]:
    taken_s, n_kept = 0.0, 0
    for block in blocks(n_points):
        begun_s = time.process_time()
        n_kept += len(chain.apply(block))
        taken_s += time.process_time() - begun_s
    return taken_s, n_kept


async def share_of_core(folder: Path, filters: str, seconds: float) -> str:
    """Measure the daemon's CPU use in a scan at 10 kHz; describe both."""
    port = rig.free_port()
    with (
        rig.mosquitto(folder, port),
        rig.simulator(folder),
        rig.daemon(folder, port, filters) as process,
    ):
        async with asyncio.timeout(seconds + SILENCE_S):
            return await _scanned(port, process, seconds)


async def _scanned(
    port: int, process: "subprocess.Popen[bytes]", seconds: float
) -> str:
    await wait_until_subscribed(port)
    points, lost, health = 0, 0, None
    async with ConfiguredClient(BrokerAddress("127.0.0.1", port)) as client:
        await subscribe(client, ARM, ("scan", "health"))
        await order_scan(client, "start", RATE_HZ)
        begun_s = begun_cpu_s = 0.0
        async for item in received(client):
            if isinstance(item.message, Scan):
                if not begun_s:
                    begun_s, begun_cpu_s = time.monotonic(), rig.cpu_s(process)
                points += len(item.message.dtime_ns)
                lost = item.message.lost
            elif isinstance(item.message, Health):
                health = item.message
            if begun_s and time.monotonic() - begun_s > seconds:
                break
        taken_s = time.monotonic() - begun_s
        share = (rig.cpu_s(process) - begun_cpu_s) / taken_s
        await order_scan(client, "stop", RATE_HZ)
    rate_hz = health.rates_hz["samples_received"] if health is not None else 0.0
    return (
        f"{100 * share:.1f} % of a core, {rate_hz:.0f} samples/s read, {lost} lost, "
        f"{points} points in {taken_s:.1f} s"
    )


def main(n_points: int = N_POINTS, seconds: float = SECONDS) -> None:
    for name, filters in (("without filters", ""), ("all filters", FILTERS)):
        with tempfile.TemporaryDirectory() as folder:
            figures = asyncio.run(share_of_core(Path(folder), filters, seconds))
        print(f"10 kHz, {name}: {figures}", flush=True)
    for line in off_line(n_points):
        print(line, flush=True)


if __name__ == "__main__":
    run_main(main)
