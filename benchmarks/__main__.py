"""`python -m benchmarks [FOLDER]`: cost and robustness of the daemon.

Streams at two rates in turn and an idle daemon, three rounds; then noise and a
corrupted line for the decoder. Latency, kernel and path have programs of their own, see
the Makefile.
"""

import json
import os
import statistics
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path

from benchmarks.drivers.decoder import corrupted, noise, speed
from benchmarks.service.idle import Idle, idle
from benchmarks.service.stream import Streamed, stream
from benchmarks.tools.command_line import run_main
from benchmarks.tools.rounds import load
from benchmarks.tools.sizes import sized

SECONDS = sized(6.0, 1.0)
ROUNDS = sized(3, 1)
RATES_HZ = (1000.0, 10_000.0)


def streams(seconds: float, n_rounds: int = ROUNDS) -> Iterator[Streamed]:
    for _ in range(n_rounds):
        for rate_hz in RATES_HZ:
            with tempfile.TemporaryDirectory() as folder:
                yield stream(Path(folder), rate_hz, seconds)


def idles(seconds: float) -> Iterator[Idle]:
    for _ in range(ROUNDS):
        for moves in (False, True):
            with tempfile.TemporaryDirectory() as folder:
                yield idle(Path(folder), seconds, moves=moves)


def bare_start_s(statement: str) -> float:
    """Return the shortest of five durations of a statement in a bare interpreter."""
    taken_s = []
    for _ in range(5):
        begun_s = time.monotonic()
        os.spawnv(os.P_WAIT, sys.executable, [sys.executable, "-c", statement])
        taken_s.append(time.monotonic() - begun_s)
    return min(taken_s)


def bare_memory_mb(statement: str) -> float:
    """Return the largest memory of a bare interpreter that runs a statement."""
    pid = os.spawnv(os.P_NOWAIT, sys.executable, [sys.executable, "-c", statement])
    _, _, used = os.wait4(pid, 0)
    return used.ru_maxrss * 1024 / 1e6


def main(folder: Path | None = None, seconds: float = SECONDS) -> None:
    before, begun_s = load(), time.monotonic()
    print(before)
    rounds = []
    for streamed in streams(seconds):
        print(streamed.line(), flush=True)
        rounds.append(streamed)
    for rate_hz in RATES_HZ:
        shares = [r.daemon_share for r in rounds if r.rate_hz == rate_hz]
        print(
            f"{rate_hz:6.0f} Hz: daemon {statistics.median(shares):.1%} of a core "
            f"({min(shares):.1%} to {max(shares):.1%})"
        )
    idle_rounds = []
    for unused in idles(seconds):
        print(unused.line(), flush=True)
        idle_rounds.append(unused)
    ready_s = [r.ready_s for r in rounds]
    bare_s, bare_mb = bare_start_s("import numpy"), bare_memory_mb("import numpy")
    print(
        f"ready after {statistics.median(ready_s):.2f} s ({min(ready_s):.2f} to "
        f"{max(ready_s):.2f}), "
        f"{statistics.median(r.start_cpu_s for r in rounds):.2f} s of CPU; "
        f"bare interpreter {bare_start_s('pass'):.2f} s, with "
        f"numpy {bare_s:.2f} s; at most "
        f"{max(r.memory_mb for r in rounds):.0f} MB, that interpreter "
        f"{bare_mb:.0f} MB"
    )
    print(noise())
    print(corrupted())
    print(speed())
    print(f"{load()}; took {time.monotonic() - begun_s:.0f} s")
    if folder is not None:
        folder.mkdir(parents=True, exist_ok=True)
        streamed_s = [asdict(r) for r in rounds]
        values = {
            "load": before,
            "bare_start_s": bare_s,
            "bare_memory_mb": bare_mb,
            "streams": streamed_s,
            "idle": [asdict(r) for r in idle_rounds],
        }
        (folder / "streams.json").write_text(json.dumps(values, indent=1))


if __name__ == "__main__":
    run_main(main)
