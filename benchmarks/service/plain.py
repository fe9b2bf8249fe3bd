"""`python -m benchmarks.service.plain [FILE]`: presses beside a plain script.

A board on a pty presses its button so many times a second. Traverse, and by turns with
it a script of some 60 lines with the same guarantees (`plain_script`), make points of
the presses, sync each to the same disk and send it through the same mosquitto to a
subscriber on a bare socket. Printed are medians of the rounds with the least and the
most, and of the ratio of each round:

- CPU time of the program for each point, all of its threads, without what the same
  program spends in that time while nobody presses (its stream, live poses, health); and
  with that;
- from the last byte of a press to the subscriber, the median and 99 %;
- whether it kept up: all points arrived, the last ones not late.

The board sends an edge again until it is acknowledged, as real ones do; what is taken
late counts as late.
"""

import contextlib
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import msgpack
import numpy as np

from benchmarks.tools import rig
from benchmarks.tools.command_line import run_main
from benchmarks.tools.presses import (
    ARM,
    NEVER_HZ,
    Spent,
    edge_board,
    figures,
    press_of,
)
from benchmarks.tools.raw_mqtt import RawClient
from benchmarks.tools.rounds import load, write_json
from benchmarks.tools.sizes import sized

WARM_UP = sized((20.0, 60), (50.0, 5))
PHASES = sized(((10.0, 25), (100.0, 200), (300.0, 450), (1000.0, 1500)), ((100.0, 40),))
"""Presses a second, and how many; what is warmed up first is not looked at."""
ROUNDS = sized(6, 1)
IDLE_AFTER_S, IDLE_S = sized((4.0, 4.0), (0.1, 0.5))
SILENCE_NS = 8_000_000_000  # without any point: no more will arrive
MOST_BEHIND_US = 20_000.0  # of the last tenth, where a program keeps up
PLAIN, TRAVERSE = "plain script", "Traverse"


@contextlib.contextmanager
def plain_script(folder: Path, port: int) -> Iterator["subprocess.Popen[bytes]"]:
    database = folder / "plain.db"
    for path in folder.glob("plain.db*"):
        path.unlink()
    run = (sys.executable, "-m", "benchmarks.service.plain_script")
    files = (folder / "board.pty", folder / "arm.toml", database)
    log = folder / "plain.log"
    with rig.program(log, *run, *map(str, files), str(port)) as process:
        rig.wait_for(database.exists, "the script's database")
        yield process


Program = Callable[
    [Path, int], contextlib.AbstractContextManager["subprocess.Popen[bytes]"]
]
PROGRAMS: dict[str, tuple[str, Program]] = {
    PLAIN: (f"plain/{ARM}/point", plain_script),
    TRAVERSE: (f"traverse/{ARM}/point", rig.daemon),
}


@dataclass(frozen=True, slots=True)
class Turn:
    """One program at one rate in one round.

    Attributes:
        pressed, came: presses, and points of them that the subscriber received.
        latency: from the last byte of a press to the subscriber.
        behind_us: the median of the last tenth.
        cpu_us: CPU time a point, without the program's own when nobody presses.
    """

    program: str
    rate_hz: float
    pressed: int
    came: int
    latency: dict[str, float]
    behind_us: float
    cpu_us: float
    all_cpu_us: float
    threads_us: tuple[float, ...]
    switches: float

    @property
    def kept_up(self) -> bool:
        """All points arrived, and the last ones were not late."""
        return self.came == self.pressed and self.behind_us < MOST_BEHIND_US


def idle_share(name: str, folder: Path, port: int) -> float:
    """Return the share of a core that a program takes while nobody presses."""
    _, program = PROGRAMS[name]
    with edge_board(folder, NEVER_HZ), program(folder, port) as process:
        time.sleep(IDLE_AFTER_S)
        before = Spent.by(process.pid)
        time.sleep(IDLE_S)
        spent = Spent.by(process.pid).since(before)
    return sum(spent.cpu_ns) * 1e-9 / IDLE_S


def turn(name: str, folder: Path, port: int, idle: float) -> Iterator[Turn]:
    """Have a program make points of presses, at one rate after the other."""
    topic, program = PROGRAMS[name]
    client = RawClient(port, "point-taker")
    client.subscribe(topic)
    firsts = np.cumsum([WARM_UP[1], *(n for _, n in PHASES)]).tolist()
    ends = {first - 1 for first in firsts}
    arrivals_ns: dict[int, int] = {}
    spent_at_start: list[Spent] = []  # of each phase, at its first point
    ended: dict[int, Spent] = {}  # at its last point, or at the next that came
    phases = [f"{rate_hz}x{n}" for rate_hz, n in (WARM_UP, *PHASES)]
    with (
        edge_board(folder, *phases, NEVER_HZ) as (log, _),
        program(folder, port) as process,
    ):
        for now_ns, payload in client.payloads(SILENCE_NS):
            read = msgpack.unpackb if name == TRAVERSE else json.loads
            press = press_of(read(payload)["counts"])
            arrivals_ns.setdefault(press, now_ns)
            if press in ends:
                ended[press] = Spent.by(process.pid)
            if press >= firsts[len(spent_at_start)]:
                spent_at_start.append(Spent.by(process.pid))
            if press == firsts[-1] - 1:
                break
        spent_at_start.append(Spent.by(process.pid))
    client.close()
    pressed_ns = [int(line) for line in log.read_text("ascii").split()]
    for number, ((rate_hz, n), first) in enumerate(
        zip(PHASES, firsts[:-1], strict=True)
    ):
        at_ns = [
            (p, arrivals_ns[p]) for p in range(first, first + n) if p in arrivals_ns
        ]
        latencies_ns = [arrival_ns - pressed_ns[press] for press, arrival_ns in at_ns]
        spent = ended.get(first + n - 1, spent_at_start[number + 1]).since(
            spent_at_start[number]
        )
        n_points = len(at_ns)
        all_cpu_us = sum(spent.cpu_ns) / (n_points - 1) * 1e-3
        elapsed_us = (at_ns[-1][1] - at_ns[0][1]) * 1e-3
        yield Turn(
            name,
            rate_hz,
            n,
            n_points,
            figures(latencies_ns),
            float(np.median(latencies_ns[-max(1, n_points // 10) :])) * 1e-3,
            all_cpu_us - idle * elapsed_us / (n_points - 1),
            all_cpu_us,
            tuple(ns / (n_points - 1) * 1e-3 for ns in spent.cpu_ns),
            spent.switches / (n_points - 1),
        )


def spread(values: list[float], digits: int = 0) -> str:
    """Median with the least and the most."""
    low, middle, high = np.percentile(values, (0, 50, 100))
    return f"{middle:.{digits}f} ({low:.{digits}f} to {high:.{digits}f})"


def lines(turns: list[Turn], rate_hz: float) -> Iterator[str]:
    of = {
        name: [t for t in turns if t.program == name and t.rate_hz == rate_hz]
        for name in PROGRAMS
    }
    columns: dict[str, Callable[[Turn], float]] = {
        "CPU a point, us": lambda t: t.cpu_us,
        "with its own, us": lambda t: t.all_cpu_us,
        "p50, us": lambda t: t.latency["p50_us"],
        "p99, us": lambda t: t.latency["p99_us"],
    }
    yield f"{rate_hz:.0f} presses a second, {len(of[PLAIN])} rounds"
    for title, value in columns.items():
        plain, ours = ([value(t) for t in of[name]] for name in (PLAIN, TRAVERSE))
        ratios = [figure / its for figure, its in zip(ours, plain, strict=True)]
        yield (
            f"  {title:17} {PLAIN} {spread(plain)}; {TRAVERSE} {spread(ours)}; "
            f"ratio {spread(ratios, 2)}"
        )
    kept = ", ".join(
        f"{name} {sum(t.kept_up for t in trials)} of {len(trials)}"
        for name, trials in of.items()
    )
    yield f"  kept up: {kept}"
    for name, trials in of.items():
        threads = " + ".join(
            f"{np.median(column):.0f}"
            for column in zip(*(t.threads_us for t in trials), strict=False)
        )
        switches = np.median([t.switches for t in trials])
        yield f"  {name}: by thread {threads} us, {switches:.1f} switches a point"


def main(path: Path | None = None) -> None:
    before = load()
    print(before)
    turns: list[Turn] = []
    with tempfile.TemporaryDirectory() as name:
        folder, port = Path(name), rig.free_port()
        with rig.mosquitto(folder, port):
            idle = {program: idle_share(program, folder, port) for program in PROGRAMS}
            idle_shares = ", ".join(
                f"{program} {share:.2%}" for program, share in idle.items()
            )
            print(f"share of a core while nobody presses: {idle_shares}", flush=True)
            for _ in range(ROUNDS):
                for program, share in idle.items():
                    turns.extend(turn(program, folder, port, share))
    for rate_hz, _ in PHASES:
        print("\n".join(lines(turns, rate_hz)))
    print(load())
    figures = {"load": before, "idle": idle, "turns": [asdict(turn) for turn in turns]}
    write_json(path, figures)


if __name__ == "__main__":
    run_main(main)
