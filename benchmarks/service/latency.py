"""`python -m benchmarks.service.latency [FILE]`: from trigger to subscriber.

A board presses its button; from the last byte on the pty to the subscriber, which is a
bare socket. In turns with it the same from a publisher on a bare socket: what the
broker and the subscriber take by themselves. A point is on the disk before it is sent,
so this time is printed too, as the daemon measures it (`point_to_disk`: to the
outbox's thread, its transaction, and back), and what a bare write and sync of 4 KiB
takes on the same disk in the same round.
"""

import contextlib
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import msgpack
import numpy as np

from benchmarks.tools import rig
from benchmarks.tools.disk import syncs_ns
from benchmarks.tools.raw_mqtt import RawClient
from benchmarks.tools.rounds import given, load, write_json
from benchmarks.tools.sizes import sized
from traverse.protocol.encoding import encode
from traverse.protocol.messages import Command, ScanArgs
from traverse.protocol.topics import command_topic

ARM = "demo-7"
RAW = "raw"
# Presses, and timed samples beside them.
RATES_HZ = ((100.0, 0.0), (100.0, 1000.0), (1000.0, 0.0))
ROUNDS = sized(3, 1)
SECONDS = sized(3.0, 0.5)


@contextlib.contextmanager
def edge_board(
    folder: Path, presses_hz: float
) -> Iterator[tuple[Path, "subprocess.Popen[bytes]"]]:
    """Run a board that presses; gives the file to which it writes press times, and it.

    What a daemon kept of an earlier board's points is not sent again.
    """
    shutil.rmtree(folder / "state", ignore_errors=True)
    shutil.copy(rig.ARM, folder / "arm.toml")
    run = (sys.executable, "-m", "benchmarks.tools.edge_board")
    log = folder / "presses.log"
    log.unlink(missing_ok=True)
    arguments = str(folder / "board.pty"), str(presses_hz)
    with rig.program(log, *run, *arguments) as board:
        rig.wait_for((folder / "board.pty").exists, "the board")
        yield log, board


def raw_latencies_ns(folder: Path, port: int, rate_hz: float, n: int) -> list[int]:
    """From a bare socket to a bare socket."""
    client = RawClient(port, "raw-taker")
    client.subscribe(RAW)
    log = folder / "raw.log"
    log.unlink(missing_ok=True)
    arrivals_ns = []
    run = (sys.executable, "-m", "benchmarks.tools.raw_mqtt")
    with rig.program(log, *run, str(port), RAW, str(rate_hz), str(n)) as sender:
        for now_ns, payload in client.payloads():
            arrivals_ns.append((int.from_bytes(payload[:8], "little"), now_ns))
            if len(arrivals_ns) == n:
                break
        sender.wait()
    client.close()
    sent_ns = [int(line) for line in log.read_text("ascii").split()]
    return [now_ns - sent_ns[number] for number, now_ns in arrivals_ns]


def begin_scan(port: int, rate_hz: float) -> None:
    """Have the daemon stream; returns when it does."""
    client = RawClient(port, "scan-starter")
    client.subscribe(f"traverse/{ARM}/health")
    client.subscribe(f"traverse/{ARM}/scan")
    args = ScanArgs(action="start", rate_hz=rate_hz)
    command = Command.carrying(args, request="latency")
    for _, payload in client.payloads():
        if "dtime_ns" in msgpack.unpackb(payload):
            break
        # A status proves that it is subscribed; the first may be the previous daemon's.
        client.publish(command_topic(ARM, "scan"), 1, encode(command, "json"))
    client.close()


def point_latencies_ns(
    folder: Path, port: int, rate_hz: float, n: int, stream_hz: float
) -> tuple[list[int], float, float, float]:
    """From the last byte of an edge to a bare socket; points sent twice count once.

    Returns:
        The latencies, the shares of a core of daemon and board meanwhile, and how long
        points took to the disk, the median reported by the daemon [us].
    """
    client = RawClient(port, "point-taker")
    client.subscribe(f"traverse/{ARM}/health")
    arrivals_ns: dict[int, int] = {}
    to_disk: dict[str, Any] = {}
    with (
        edge_board(folder, rate_hz) as (log, board),
        rig.daemon(folder, port) as daemon,
    ):
        if stream_hz:
            begin_scan(port, stream_hz)
        begun_s = time.monotonic()
        begun_cpu_s = rig.cpu_s(daemon), rig.cpu_s(board)
        client.subscribe(f"traverse/{ARM}/point")
        for now_ns, payload in client.payloads():
            message = msgpack.unpackb(payload)
            if "latencies" in message:
                to_disk = message["latencies"].get("point_to_disk") or to_disk
            else:
                arrivals_ns.setdefault(message["seq"], now_ns)
            if len(arrivals_ns) == n:
                break
        elapsed_s = time.monotonic() - begun_s
        share, board_share = (
            (rig.cpu_s(process) - before_s) / elapsed_s
            for process, before_s in zip((daemon, board), begun_cpu_s, strict=True)
        )
    client.close()
    pressed_ns = [int(line) for line in log.read_text("ascii").split()]
    latencies_ns = [now_ns - pressed_ns[seq] for seq, now_ns in arrivals_ns.items()]
    return latencies_ns, share, board_share, to_disk.get("p50_us", 0.0)


def figures(values_ns: list[int]) -> dict[str, float]:
    """Median, 99th percentile and largest in microseconds."""
    p50, p99, largest = np.percentile(values_ns, [50, 99, 100]) * 1e-3
    return {"p50_us": p50, "p99_us": p99, "largest_us": largest}


@dataclass(frozen=True, slots=True)
class Round:
    """Bare sockets and points in turn, figures in microseconds.

    Attributes:
        raw, point: latencies.
        sync: a write of 4 KiB and its sync.
        to_disk_us: points to the disk, the median.
        daemon_share, board_share: of a core.
    """

    raw: dict[str, float]
    point: dict[str, float]
    sync: dict[str, float]
    to_disk_us: float
    daemon_share: float
    board_share: float

    def line(self) -> str:
        """For people: ratios with the disk, and in the median without it."""
        raw, point = self.raw, self.point
        ratios = {name: point[name] / raw[name] for name in ("p50_us", "p99_us")}
        without_us = point["p50_us"] - self.to_disk_us
        return (
            f"bare sockets p50 {raw['p50_us']:.0f} us, p99 {raw['p99_us']:.0f} us; "
            f"points p50 {point['p50_us']:.0f} us ({ratios['p50_us']:.1f} times), p99 "
            f"{point['p99_us']:.0f} us ({ratios['p99_us']:.1f} times), largest "
            f"{point['largest_us']:.0f} us; p50 to the disk {self.to_disk_us:.0f} us, "
            f"without that {without_us:.0f} us ({without_us / raw['p50_us']:.1f} "
            f"times); bare write and sync p50 {self.sync['p50_us']:.0f} us, p99 "
            f"{self.sync['p99_us']:.0f} us; daemon {self.daemon_share:.1%} of a core"
        )


def rounds(
    folder: Path, rate_hz: float, stream_hz: float, n_rounds: int, seconds: float
) -> Iterator[Round]:
    """Bare sockets and points in turn, through one broker."""
    port, n = rig.free_port(), round(rate_hz * seconds)
    with rig.mosquitto(folder, port):
        for _ in range(n_rounds):
            raw = figures(raw_latencies_ns(folder, port, rate_hz, n))
            sync = figures(syncs_ns(folder, rate_hz))
            found_ns, *shares, to_disk_us = point_latencies_ns(
                folder, port, rate_hz, n, stream_hz
            )
            yield Round(raw, figures(found_ns), sync, to_disk_us, *shares)


def latency(
    rate_hz: float, stream_hz: float, n_rounds: int, seconds: float
) -> dict[str, object]:
    """Measure everything at one rate, and print results as they arrive."""
    beside = f", stream of {stream_hz:.0f} Hz" if stream_hz else ""
    with tempfile.TemporaryDirectory() as folder:
        found = []
        for one in rounds(Path(folder), rate_hz, stream_hz, n_rounds, seconds):
            found.append(asdict(one))
            print(f"{rate_hz:5.0f}/s{beside}: {one.line()}; {load()}", flush=True)
    return {
        "rate_hz": rate_hz,
        "stream_hz": stream_hz,
        "seconds": seconds,
        "rounds": found,
    }


def main(path: Path | None = None) -> None:
    """Print the figures, and keep them in a file where one is named."""
    print(load())
    before = load()
    found = [latency(*rates_hz, ROUNDS, SECONDS) for rates_hz in RATES_HZ]
    print(load())
    write_json(path, {"load": before, "latency": found})


if __name__ == "__main__":
    main(*given(Path))
