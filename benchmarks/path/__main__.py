"""`python -m benchmarks.path [FILE]`: the whole path and its stages, a sample."""

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from benchmarks.path.line import RATE_HZ, line_bytes
from benchmarks.path.plain_loop import PlainLoop
from benchmarks.path.whole import (
    FROM_MEMORY,
    LIKE_A_LINE,
    WholePath,
    stages,
    whole_path,
)
from benchmarks.tools.command_line import run_main
from benchmarks.tools.rig import ARM
from benchmarks.tools.rounds import Table, Task, report, timed
from benchmarks.tools.sizes import sized
from traverse.daemon.pose.arm_model import read_model
from traverse.protocol.encoding import decode
from traverse.protocol.messages import Scan

ROUNDS = sized(15, 2)
N_SAMPLES = sized(100_000, 2000)
N_PLAIN = sized(1000, 50)  # the plain loop takes its time
AGREEMENT_MM = 1e-9


def check_agreement(payloads: list[bytes], texts: list[str]) -> float:
    """The largest difference between the places of both [mm].

    Raises:
        ValueError: their results for the same samples differ.
    """
    decoded = [decode(Scan, payload) for payload in payloads]
    scans = [scan for scan in decoded if len(scan.dtime_ns)]
    xyz_mm = np.concatenate([scan.xyz_mm for scan in scans])
    counts = np.concatenate([scan.counts for scan in scans if scan.counts is not None])
    plain = [json.loads(text) for text in texts]
    largest_mm = float(
        np.abs(xyz_mm - [reference_pose["xyz_mm"] for reference_pose in plain]).max()
    )
    same_counts = np.array_equal(
        counts, [reference_pose["counts"] for reference_pose in plain]
    )
    if not (same_counts and largest_mm <= AGREEMENT_MM):
        raise ValueError(
            f"the plain loop is {largest_mm:g} mm off, counts the same: {same_counts}; "
            f"expected at most {AGREEMENT_MM:g} mm and the same counts"
        )
    return largest_mm


def tables(
    n_samples: int = N_SAMPLES, n_plain: int = N_PLAIN, rounds: int = ROUNDS
) -> Iterator[Table]:
    model = read_model(ARM, {"base": None})
    data, some = line_bytes(n_samples, model), line_bytes(n_plain, model)
    payloads = WholePath(model, RATE_HZ).run([some], 1)
    largest_mm = check_agreement(payloads, PlainLoop(model).run(some))
    print(f"plain loop and path agree within {largest_mm:.1e} mm")
    ways = [
        whole_path(model, RATE_HZ, data, n_samples, w)
        for w in (FROM_MEMORY, LIKE_A_LINE)
    ]
    plain = Task("plain loop", lambda: PlainLoop(model).run(some), n_plain, True)
    yield timed("bytes to payloads, a sample", [*ways, plain], rounds)
    for way in (FROM_MEMORY, LIKE_A_LINE):
        tasks = [
            whole_path(model, RATE_HZ, data, n_samples, way),
            *stages(model, RATE_HZ, data, n_samples, way),
        ]
        yield timed(f"stages, {way.name}", tasks, rounds)


def main(path: Path | None = None) -> None:
    report(tables(), path)


if __name__ == "__main__":
    run_main(main)
