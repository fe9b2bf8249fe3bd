"""`make endurance`: `python -m benchmarks.service.endurance [MINUTES] [FILE]`.

A scan for an hour: resident memory at five minutes and at the end, file descriptors,
threads, samples lost. Exit status 1 where memory grew by more than 5 %, descriptors or
threads by any, or the daemon lost samples. A run of less than ten minutes compares with
half its time, one of less than a minute judges losses alone.

The simulated board keeps unread bytes for 1.3 s. Where it drops
samples because its own program had not run for a second, on a busy computer, this is
reported, and is not the daemon's fault.
"""

import asyncio
import json
import subprocess
import tempfile
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from benchmarks.tools import rig
from benchmarks.tools.command_line import run_main
from benchmarks.tools.rounds import load, write_json
from benchmarks.tools.sizes import sized
from traverse.client import Arm
from traverse.protocol.messages import Scan

ARM = "demo-7"
TRUTH = "truth.jsonl"
STOOD_S = 1.0
RATE_HZ = 1000.0
MINUTES = sized(60.0, 0.1)
EARLY_S = 300.0
FILLED_S = 60.0  # until then what a daemon holds grows to its usual size
MAX_GROWTH = 0.05


@dataclass(frozen=True, slots=True)
class Size:
    """Memory and descriptors of the daemon at a time."""

    after_s: float
    rss_mb: float
    own_mb: float
    descriptors: int
    threads: int

    @classmethod
    def of(cls, process: "subprocess.Popen[bytes]", after_s: float) -> "Size":
        proc = Path(f"/proc/{process.pid}")
        return cls(
            after_s,
            rig.rss_mb(process),
            rig.own_mb(process),
            len(list((proc / "fd").iterdir())),
            len(list((proc / "task").iterdir())),
        )

    def line(self) -> str:
        return (
            f"{self.after_s:6.0f} s  {self.rss_mb:7.1f} MB, "
            f"{self.own_mb:.1f} of them its own  "
            f"{self.descriptors:3d} descriptors  {self.threads:2d} threads"
        )


@dataclass
class Followed:
    """Received part of the scan.

    Attributes:
        lost: by the line, of which ``excused`` because the board's program stood still.
    """

    points: int = 0
    lost: int = 0
    excused: int = 0
    dropped: int = 0
    missing: int = 0

    def add(self, block: Scan) -> None:
        self.points += len(block.dtime_ns)
        self.lost, self.dropped = block.lost, block.dropped


async def follow(
    port: int, seconds: float, process: "subprocess.Popen[bytes]"
) -> tuple[list[Size], Followed]:
    followed, sizes = Followed(), []
    early_s = min(EARLY_S, seconds / 2)
    looks = sorted({early_s, *(seconds * i / 10 for i in range(1, 11))})
    async with Arm(ARM, f"127.0.0.1:{port}") as arm:
        async with arm.scan(rate_hz=RATE_HZ) as blocks:
            begun_s = time.monotonic()
            async for block in blocks:
                followed.add(block)
                after_s = time.monotonic() - begun_s
                if after_s >= looks[0]:
                    looks.pop(0)
                    sizes.append(Size.of(process, after_s))
                    print(sizes[-1].line(), flush=True)
                if not looks:
                    break
        followed.missing = blocks.missing
    return sizes, followed


def drops(truth: Path) -> list[dict[str, Any]]:
    lines = map(json.loads, truth.read_text("utf-8").splitlines())
    return [line for line in lines if line["event"] == "dropped"]


def faults(sizes: list[Size], followed: Followed) -> list[str]:
    end = sizes[-1]
    early = next(
        size for size in sizes if size.after_s >= min(EARLY_S, end.after_s / 2)
    )
    complaints = []
    is_filled = end.after_s > FILLED_S
    if is_filled and end.rss_mb > early.rss_mb * (1 + MAX_GROWTH):
        complaints.append(f"memory grew from {early.rss_mb:.1f} to {end.rss_mb:.1f} MB")
    if is_filled and end.descriptors > early.descriptors:
        complaints.append(f"{end.descriptors - early.descriptors} more descriptors")
    if is_filled and end.threads > early.threads:
        complaints.append(f"{end.threads - early.threads} more threads")
    losses = {
        "lost": followed.lost - followed.excused,
        "dropped": followed.dropped,
        "missing": followed.missing - followed.excused,
    }
    return complaints + [f"{n} points {name}" for name, n in losses.items() if n > 0]


def main(minutes: float = MINUTES, path: Path | None = None) -> int:
    print(load())
    with tempfile.TemporaryDirectory() as name:
        folder, port = Path(name), rig.free_port()
        with (
            rig.mosquitto(folder, port),
            rig.simulator(folder, top=f'truth_log = "{TRUTH}"'),
            rig.daemon(folder, port) as process,
        ):
            sizes, followed = asyncio.run(follow(port, 60.0 * minutes, process))
        dropped = drops(folder / TRUTH)
    for drop in dropped:
        is_excused = drop["stood_s"] >= STOOD_S
        followed.excused += drop["samples"] * is_excused
        print(
            f"the board dropped {drop['samples']} samples {drop['time_s']:.0f} s after "
            "its start: "
            + (
                f"its program had not run for {drop['stood_s']:.1f} s"
                if is_excused
                else "the daemon did not read"
            )
        )
    complaints = faults(sizes, followed)
    print(
        f"{followed.points} points; lost by the line {followed.lost} "
        f"({followed.excused} excused), dropped by the daemon {followed.dropped}, "
        f"missing here {followed.missing}; {load()}"
    )
    for fault in complaints:
        print(f"FAULT: {fault}")
    figures = {"sizes": [asdict(size) for size in sizes], "scan": asdict(followed)}
    write_json(path, figures)
    return 1 if complaints else 0


if __name__ == "__main__":
    run_main(main)
