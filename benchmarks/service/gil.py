"""`python -m benchmarks.service.gil [FILE]`: how long a reader waits for the GIL.

A reader thread waits on a pipe, as for a serial port, into which a program of its own
writes the time every 2 ms. The delay until the thread has read it is the system's
wake-up and the wait for the lock that the main thread may hold.
"""

import contextlib
import os
import select
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.path.line import RATE_HZ, cut, line_bytes
from benchmarks.path.plain_loop import PlainLoop
from benchmarks.path.whole import LIKE_A_LINE, Timing, scanner
from benchmarks.service.effects import SETS, arm_with, block_of
from benchmarks.tools.command_line import run_main
from benchmarks.tools.rig import ARM
from benchmarks.tools.rounds import load, write_json
from benchmarks.tools.sizes import sized
from traverse.daemon.clock import HostClock
from traverse.daemon.pose.arm_model import ArmModel, read_model
from traverse.daemon.pose.pipeline import Pipeline
from traverse.drivers.base.values import CountSamples
from traverse.kinematics.effects.arm_effects import effects_from_arm
from traverse.kinematics.effects.pose import corrected_pose
from traverse.kinematics.model.forward import numpy_pose, probe_pose
from traverse.kinematics.model.geometry import geometry_from_arm
from traverse.protocol.encoding import encode
from traverse.protocol.latch_board.messages import Decoder, SampleBlock
from traverse.protocol.messages import Scan

N_POSES = sized(100_000, 2000)
N_PLAIN = sized(200, 20)
SECONDS = sized(1.0, 0.05)
ROUNDS = 3
BLOCK_S = 0.02
# Of the reader's program: a time in ns every 2 ms.
WRITER = """
import sys, time
while True:
    time.sleep(0.002)
    sys.stdout.buffer.write(time.monotonic_ns().to_bytes(8, "little"))
    sys.stdout.buffer.flush()
"""


class Reader:
    """The thread that waits; `delays_ns` are its measured delays."""

    def __init__(self, pipe: int) -> None:
        self._pipe = pipe
        self.delays_ns: list[int] = []
        self._stopping = False
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def stop(self) -> None:
        self._stopping = True
        self._thread.join()

    def _run(self) -> None:
        while not self._stopping:
            select.select([self._pipe], [], [])
            stamps = os.read(self._pipe, 4096)
            now_ns = time.monotonic_ns()
            # The first of those that arrived together has waited longest.
            self.delays_ns.append(now_ns - int.from_bytes(stamps[:8], "little"))


@contextlib.contextmanager
def stamps() -> Iterator[int]:
    command = (sys.executable, "-c", WRITER)
    with subprocess.Popen(command, stdout=subprocess.PIPE) as writer:
        try:
            if writer.stdout is None:
                raise RuntimeError("the writer has no pipe")
            yield writer.stdout.fileno()
        finally:
            writer.kill()


def delays(turn: Callable[[], object], seconds: float) -> dict[str, float]:
    """Measure a reader's wait while ``turn`` is called repeatedly: us."""
    with stamps() as pipe:
        select.select([pipe], [], [])
        reader = Reader(pipe)
        until_s = time.monotonic() + seconds
        try:
            while time.monotonic() < until_s:
                turn()
        finally:
            reader.stop()
    p50, p99, longest = np.percentile(reader.delays_ns, (50, 99, 100)) * 1e-3
    return {"p50_us": p50, "p99_us": p99, "longest_us": longest}


def loads() -> dict[str, Callable[[], object]]:
    model = read_model(ARM, {"base": None})
    effective = arm_with(SETS["all 20"])
    angles_rad = np.random.default_rng(1).uniform(-3.0, 3.0, (N_POSES, 7))
    plain, some = PlainLoop(model), line_bytes(N_PLAIN, model)
    return {
        "nothing": partial(time.sleep, BLOCK_S),
        "kernel, 100 000 poses": partial(probe_pose, model.geometry, angles_rad),
        "kernel, 100 000 poses with 20 effects": partial(
            corrected_pose,
            geometry_from_arm(effective),
            effects_from_arm(effective),
            block_of(N_POSES),
        ),
        "NumPy, 100 000 poses": partial(numpy_pose, model.geometry, angles_rad),
        "path of 10 kHz": partial(paced, follow(model)),
        "path without a pause": follow(model),
        "plain loop": partial(plain.run, some),
        "Python that never calls": partial(count, 1_000_000),
    }


def follow(model: ArmModel) -> Callable[[], object]:
    timing, decoder = Timing(), Decoder()
    reads = cut(line_bytes(100_000, model), LIKE_A_LINE.read_bytes)
    timed = [
        timing.samples(block)
        for data in reads
        for block in decoder.feed(data)
        if isinstance(block, SampleBlock)
    ]
    n, k = len(timed), LIKE_A_LINE.reads
    return partial(
        next, _turns(model, [timed[start : start + k] for start in range(0, n, k)])
    )


def _encoded(scan: Scan, dropped: Callable[[], object]) -> bool:
    del dropped  # never called: everything is taken
    return bool(encode(scan, "msgpack"))


def _turns(model: ArmModel, blocks: list[list[CountSamples]]) -> Iterator[None]:
    while True:  # scan after scan of the same samples
        pipeline = Pipeline(model, HostClock())
        scanning = scanner(model, RATE_HZ, _encoded)
        for block in blocks:
            samples = CountSamples.joined(block)
            scanning.take(model, pipeline.poses(samples))
            yield


def paced(turn: Callable[[], object]) -> None:
    begun_s = time.monotonic()
    turn()
    time.sleep(max(0.0, BLOCK_S - (time.monotonic() - begun_s)))


def count(n: int) -> int:
    """Count in pure Python, which releases the lock only when forced to."""
    total = 0
    for k in range(n):
        total += k
    return total


def main(path: Path | None = None) -> None:
    print(f"{load()}; switch interval {1e3 * sys.getswitchinterval():g} ms")
    delays_by_turn: dict[str, list[dict[str, float]]] = {}
    for _ in range(ROUNDS):
        for name, turn in loads().items():
            delays_by_turn.setdefault(name, []).append(delays(turn, SECONDS))
    for name, rounds in delays_by_turn.items():
        ranges = [
            sorted(round_of_turn[key] for round_of_turn in rounds) for key in rounds[0]
        ]
        print(
            f"{name:40} p50 {ranges[0][1]:6.0f} us, p99 {ranges[1][1]:6.0f} us, "
            f"longest {ranges[2][1]:6.0f} us ({ranges[2][0]:.0f} to {ranges[2][2]:.0f})"
        )
    print(load())
    write_json(path, delays_by_turn)


if __name__ == "__main__":
    run_main(main)
