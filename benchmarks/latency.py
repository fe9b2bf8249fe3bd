"""Trigger to subscriber, beside a bare MQTT ping through the same broker."""

import asyncio
import contextlib
import shutil
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from benchmarks import rig
from clients.subscription import connection, received, subscribe
from protocol.messages import Point

ARM = "demo-7"
TOPIC = "ping"


@contextlib.contextmanager
def edge_board(folder: Path, presses_hz: float) -> Iterator[Path]:
    """The board that presses; gives the file that its press times go to."""
    shutil.copy(rig.ARM, folder / "arm.toml")
    run = (sys.executable, "-m", "benchmarks.edge_board")
    log = folder / "presses.log"
    with rig.program(log, *run, str(folder / "board.pty"), str(presses_hz)):
        rig.wait_for((folder / "board.pty").exists, "the board")
        yield log


async def point_arrivals_ns(port: int, n_points: int) -> dict[int, int]:
    """Monotonic arrival time of each point, by its number."""
    arrivals: dict[int, int] = {}
    async with connection("127.0.0.1", port) as client:
        await subscribe(client, ARM, ("point",))
        async for item in received(client):
            arrived_ns = time.monotonic_ns()
            if isinstance(item.message, Point):
                arrivals[item.message.seq] = arrived_ns
                if len(arrivals) >= n_points:
                    return arrivals
    return arrivals


async def ping_ns(port: int, n_pings: int, rate_hz: float, size: int) -> list[int]:
    """Time from publishing to the subscriber's callback, of bare messages, QoS 1."""
    taken: list[int] = []
    async with (
        connection("127.0.0.1", port) as sender,
        connection("127.0.0.1", port) as taker,
    ):
        await taker.subscribe(TOPIC, qos=1)

        async def take() -> None:
            async for message in taker.messages:
                payload = message.payload
                if isinstance(payload, bytes):
                    sent_ns = int.from_bytes(payload[:8], "little")
                    taken.append(time.monotonic_ns() - sent_ns)
                if len(taken) >= n_pings:
                    return

        taking = asyncio.create_task(take())
        due_s = time.monotonic()
        for _ in range(n_pings):
            due_s += 1.0 / rate_hz
            await asyncio.sleep(max(0.0, due_s - time.monotonic()))
            now = time.monotonic_ns().to_bytes(8, "little")
            await sender.publish(TOPIC, now.ljust(size, b"\0"), qos=1)
        await taking
    return taken


def figures(values_ns: list[int]) -> str:
    """Median and 99th percentile in milliseconds."""
    p50, p99, worst = np.percentile(values_ns, [50, 99, 100]) * 1e-6
    return f"p50 {p50:.3f} ms, p99 {p99:.3f} ms, largest {worst:.3f} ms"


def latency(folder: Path, rate_hz: float = 100.0, n_points: int = 2000) -> list[str]:
    """Lines of the table: pings, then points, through one broker."""
    port = rig.free_port()
    with rig.mosquitto(folder, port):
        pings = asyncio.run(ping_ns(port, n_points, rate_hz, 500))
        with edge_board(folder, rate_hz) as log, rig.daemon(folder, port):
            arrivals = asyncio.run(point_arrivals_ns(port, n_points))
        after = asyncio.run(ping_ns(port, n_points, rate_hz, 500))
    pressed = [int(line) for line in log.read_text("ascii").split()]
    points = [arrived - pressed[seq] for seq, arrived in arrivals.items()]
    return [
        f"bare ping QoS 1 before: {figures(pings)}",
        f"trigger to subscriber:  {figures(points)}   ({len(points)} points at "
        f"{rate_hz:g}/s, from the last byte on the pty to the subscriber's callback)",
        f"bare ping QoS 1 after:  {figures(after)}",
    ]
