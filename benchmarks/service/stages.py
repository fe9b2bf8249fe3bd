"""`python -m benchmarks.service.stages [FILE]`: durations of the stages of a press.

From the last byte of a board to a subscriber on a bare socket, at 100 presses a second:
medians of rounds. The daemon notes the instants itself
(`benchmarks.tools.staged_daemon`), which takes some microseconds each.
"""

import tempfile
from itertools import pairwise
from pathlib import Path

import msgpack
import numpy as np

from benchmarks.tools import rig
from benchmarks.tools.command_line import run_main
from benchmarks.tools.presses import ARM, edge_board
from benchmarks.tools.raw_mqtt import RawClient
from benchmarks.tools.rounds import load, write_json
from benchmarks.tools.sizes import sized
from benchmarks.tools.staged_daemon import STAGES

RATE_HZ = 100.0
ROUNDS = sized(5, 1)
N_POINTS = sized(400, 10)
PRESSED, RECEIVED = "pressed", "at the subscriber"


def one_round(folder: Path, port: int) -> dict[str, float]:
    """Median time to each stage from the one before, and of the whole [us]."""
    client = RawClient(port, "point-taker")
    arrivals_ns: dict[int, int] = {}
    instants = folder / "instants"
    run = ("benchmarks.tools.staged_daemon", str(instants))
    with edge_board(folder, RATE_HZ) as (log, _), rig.daemon(folder, port, run=run):
        client.subscribe(f"traverse/{ARM}/point")
        for now_ns, payload in client.payloads():
            arrivals_ns.setdefault(msgpack.unpackb(payload)["seq"], now_ns)
            if len(arrivals_ns) == N_POINTS:
                break
    client.close()
    at_ns: dict[str, list[int]] = {stage: [] for stage in STAGES}
    for line in instants.read_text().splitlines():
        stage, ns = line.split("\t")
        at_ns[stage].append(int(ns))
    pressed_ns = [int(line) for line in log.read_text("ascii").split()]
    columns = {PRESSED: pressed_ns, **at_ns}
    seqs = [seq for seq in arrivals_ns if seq < min(map(len, columns.values()))]
    table = {name: np.array(column)[seqs] for name, column in columns.items()}
    table[RECEIVED] = np.array([arrivals_ns[seq] for seq in seqs])
    medians_us = {
        later: float(np.median(table[later] - table[earlier])) * 1e-3
        for earlier, later in pairwise(table)
    }
    total = table[RECEIVED] - table[PRESSED]
    return medians_us | {"whole": float(np.median(total)) * 1e-3}


def main(path: Path | None = None) -> None:
    port, before = rig.free_port(), load()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        with rig.mosquitto(folder, port):
            rounds = [one_round(folder, port) for _ in range(ROUNDS)]
    print(before)
    for stage in rounds[0]:
        values = [stage_round[stage] for stage_round in rounds]
        print(
            f"{stage:>24} {np.median(values):6.0f} us "
            f"({min(values):.0f} to {max(values):.0f})"
        )
    write_json(path, {"load": before, "stages": rounds})


if __name__ == "__main__":
    run_main(main)
