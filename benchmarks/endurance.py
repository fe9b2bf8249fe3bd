"""`make endurance`: `python -m benchmarks.endurance [MINUTES] [FILE]`, at 1 kHz.

A scan for an hour: resident memory at five minutes and at the end, file descriptors,
threads, samples lost. Exit status 1 where memory grew by more than 5 %, descriptors or
threads by any, or the daemon lost samples. A run of less than ten minutes compares with
half its time.
"""

import asyncio
import json
import subprocess
import sys
import tempfile
import time
from dataclasses import asdict, dataclass
from pathlib import Path

from benchmarks import rig
from benchmarks.rounds import load
from clients import Arm
from protocol.messages import Scan

ARM = "demo-7"
RATE_HZ = 1000.0
EARLY_S = 300.0
MAX_GROWTH = 0.05


@dataclass(frozen=True, slots=True)
class Size:
    """What the daemon holds at a time."""

    after_s: float
    rss_mb: float
    descriptors: int
    threads: int

    @classmethod
    def of(cls, process: "subprocess.Popen[bytes]", after_s: float) -> "Size":
        """Of a program now."""
        proc = Path(f"/proc/{process.pid}")
        return cls(
            after_s,
            rig.rss_mb(process),
            len(list((proc / "fd").iterdir())),
            len(list((proc / "task").iterdir())),
        )

    def line(self) -> str:
        """It for people."""
        return (
            f"{self.after_s:6.0f} s  {self.rss_mb:7.1f} MB  "
            f"{self.descriptors:3d} descriptors  {self.threads:2d} threads"
        )


@dataclass
class Followed:
    """What came of the scan."""

    points: int = 0
    lost: int = 0
    dropped: int = 0
    missing: int = 0

    def add(self, block: Scan) -> None:
        """A block has come."""
        self.points += len(block.dtime_ns)
        self.lost, self.dropped = block.lost, block.dropped


async def follow(
    port: int, seconds: float, process: "subprocess.Popen[bytes]"
) -> tuple[list[Size], Followed]:
    """Scan, and look at the daemon ten times and at five minutes."""
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


def faults(sizes: list[Size], followed: Followed) -> list[str]:
    """What must not be."""
    end = sizes[-1]
    early = next(one for one in sizes if one.after_s >= min(EARLY_S, end.after_s / 2))
    found = []
    if end.rss_mb > early.rss_mb * (1 + MAX_GROWTH):
        found.append(f"memory grew from {early.rss_mb:.1f} to {end.rss_mb:.1f} MB")
    if end.descriptors > early.descriptors:
        found.append(f"{end.descriptors - early.descriptors} more descriptors")
    if end.threads > early.threads:
        found.append(f"{end.threads - early.threads} more threads")
    losses = {name: getattr(followed, name) for name in ("lost", "dropped", "missing")}
    return found + [f"{n} points {name}" for name, n in losses.items() if n]


def main(minutes: float, path: Path | None) -> int:
    """Run it; the exit status."""
    print(load())
    with tempfile.TemporaryDirectory() as name:
        folder, port = Path(name), rig.free_port()
        with (
            rig.mosquitto(folder, port),
            rig.simulator(folder),
            rig.daemon(folder, port) as process,
        ):
            sizes, followed = asyncio.run(follow(port, 60.0 * minutes, process))
    found = faults(sizes, followed)
    print(
        f"{followed.points} points; lost by the line {followed.lost}, dropped by the "
        f"daemon {followed.dropped}, missing here {followed.missing}; {load()}"
    )
    for fault in found:
        print(f"FAULT: {fault}")
    if path is not None:
        path.parent.mkdir(parents=True, exist_ok=True)
        figures = {"sizes": [asdict(one) for one in sizes], "scan": asdict(followed)}
        path.write_text(json.dumps(figures, indent=1))
    return 1 if found else 0


if __name__ == "__main__":
    given = sys.argv[1:]
    sys.exit(
        main(
            float(given[0]) if given else 60.0,
            Path(given[1]) if len(given) > 1 else None,
        )
    )
