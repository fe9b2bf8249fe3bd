"""`python -m benchmarks.service.points [FILE] [SECONDS]`: triggered points.

A board on a pty presses its button so many times a second; daemon, mosquitto and a
subscriber on a bare socket as in `benchmarks.service.latency`. Printed are: whether all
points arrived, how long that took, what the disk took of it, and the CPU time of the
daemon for each point, by thread. The share that the daemon uses without points (its
stream and periodic work) is measured first and subtracted.

The board sends no edge again: one that finds no room in the daemon is a point lost.
"""

import os
import tempfile
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import msgpack

from benchmarks.service.latency import ARM, edge_board, figures
from benchmarks.tools import rig
from benchmarks.tools.disk import syncs_ns
from benchmarks.tools.raw_mqtt import RawClient
from benchmarks.tools.rounds import given, load, write_json

RATES_HZ = (100.0, 300.0, 1000.0)
ROUNDS = 3
SECONDS = 20.0
IDLE_S = 3.0
PATIENCE = 1.5  # times the time that the presses take
NEVER_HZ = 1e-4


@dataclass(frozen=True, slots=True)
class Taken:
    """One round.

    Attributes:
        pressed, came: presses, and points that the subscriber received of them.
        latency: from the last byte of a press to the subscriber.
        sync: of 4 KiB on the same disk, before the round.
        to_disk: from a point to its transaction's end, as the daemon reports.
        threads_us: CPU time a point, threads in the order of their start: event loop,
            others, reader, outbox, recorder.
        counters: of the daemon that are not 0.
    """

    rate_hz: float
    pressed: int
    came: int
    latency: dict[str, float]
    sync: dict[str, float]
    to_disk: dict[str, float]
    threads_us: list[float]
    counters: dict[str, int]

    def line(self) -> str:
        """For people."""
        disk, sync, latency = self.to_disk, self.sync, self.latency
        lost = {k: v for k, v in self.counters.items() if "lost" in k or "refus" in k}
        threads = " + ".join(f"{us:.0f}" for us in self.threads_us)
        return (
            f"{self.rate_hz:5.0f}/s: {self.came} of {self.pressed} points, lost or "
            f"refused {lost or 'none'}; p50 {latency['p50_us'] / 1e3:.2f} ms, p99 "
            f"{latency['p99_us'] / 1e3:.1f} ms; of these to the disk p50 "
            f"{disk.get('p50_us', 0) / 1e3:.2f} ms, p99 "
            f"{disk.get('p99_us', 0) / 1e3:.1f} ms, a bare write and sync p50 "
            f"{sync['p50_us'] / 1e3:.2f} ms, p99 {sync['p99_us'] / 1e3:.1f} ms; CPU "
            f"{sum(self.threads_us):.0f} us a point ({threads}); {load()}"
        )


def threads_ns(pid: int) -> dict[int, int]:
    """CPU time of each thread of a program, in the order of their start."""
    folder = Path(f"/proc/{pid}/task")
    return {
        int(number): int((folder / number / "schedstat").read_text("ascii").split()[0])
        for number in sorted(os.listdir(folder), key=int)
    }


def idle_share(folder: Path, port: int) -> dict[int, float]:
    """Share of a core of each thread of the daemon without presses."""
    with edge_board(folder, NEVER_HZ), rig.daemon(folder, port) as process:
        time.sleep(1.0)
        before = threads_ns(process.pid)
        time.sleep(IDLE_S)
        after = threads_ns(process.pid)
    shares = [after[number] - before.get(number, 0) for number in after]
    return {place: ns / (IDLE_S * 1e9) for place, ns in enumerate(shares)}


def take(
    folder: Path, port: int, rate_hz: float, seconds: float, idle: dict[int, float]
) -> Taken:
    """Press the button for some time, and count the points."""
    sync = figures(syncs_ns(folder, rate_hz))
    client = RawClient(port, "point-taker")
    client.subscribe(f"traverse/{ARM}/health")
    arrivals_ns: dict[int, int] = {}
    health: dict[str, Any] = {}
    wanted = round(rate_hz * seconds)
    with edge_board(folder, rate_hz) as (log, _), rig.daemon(folder, port) as process:
        before, begun_s, until_s = threads_ns(process.pid), None, float("inf")
        client.subscribe(f"traverse/{ARM}/point")
        for now_ns, payload in client.payloads():
            message = msgpack.unpackb(payload)
            if message["schema"].startswith("traverse/health/"):
                if message["latencies"].get("point_to_disk"):
                    health = message
            elif message["seq"] not in arrivals_ns:
                arrivals_ns[message["seq"]] = now_ns
                if begun_s is None:
                    before, begun_s = threads_ns(process.pid), time.monotonic()
                    until_s = begun_s + PATIENCE * seconds
            if len(arrivals_ns) >= wanted or time.monotonic() > until_s:
                break
        elapsed_s = time.monotonic() - (begun_s or 0.0)
        after = threads_ns(process.pid)
    client.close()
    pressed_ns = [int(line) for line in log.read_text("ascii").split()]
    n = len(arrivals_ns)
    return Taken(
        rate_hz,
        wanted,
        n,
        figures([ns - pressed_ns[seq] for seq, ns in arrivals_ns.items()]),
        sync,
        health.get("latencies", {}).get("point_to_disk", {}),
        [
            max(0.0, spent_ns - idle.get(place, 0.0) * elapsed_s * 1e9) / n * 1e-3
            for place, spent_ns in enumerate(
                after[number] - before.get(number, 0) for number in after
            )
        ],
        {name: value for name, value in health.get("counters", {}).items() if value},
    )


def main(path: Path | None = None, seconds: float = SECONDS) -> None:
    """Print the rounds, and keep them in a file where one is named."""
    found = []
    with tempfile.TemporaryDirectory() as name:
        folder, port = Path(name), rig.free_port()
        with rig.mosquitto(folder, port):
            idle = idle_share(folder, port)
            print(f"without points {sum(idle.values()):.1%} of a core; {load()}")
            for _ in range(ROUNDS):
                for rate_hz in RATES_HZ:
                    taken = take(folder, port, rate_hz, seconds, idle)
                    print(taken.line(), flush=True)
                    found.append(asdict(taken))
    write_json(path, found)


if __name__ == "__main__":
    main(*given(Path, float))
