"""Time tasks in turn, round after round, and say how they compare.

Times of a busy machine are worth little; the ratio of two that were taken one right
after the other is worth more. So everything in a table is timed once a round, and the
figures are medians over the rounds with the 10th and 90th percentile beside them. What
is taken is the CPU time of all threads, so that waiting for a core does not count.
pyperf would time one task after the other, each in programs of its own, and a machine
that becomes busy between them would decide the ratio; its file format is used, so that
`pyperf show`, `stats` and `compare_to` read the results.
"""

import gc
import json
import os
import statistics
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.tools.sizes import sized

try:
    import pyperf
except ImportError:  # only `make bench` installs it
    pyperf = None

ROUNDS = sized(25, 2)
ROUND_S = sized(0.01, 1e-4)  # a task that takes less is repeated within a round


@dataclass(frozen=True, slots=True)
class Task:
    """Something to be timed.

    Attributes:
        n: poses, samples or the like of one call.
        is_peer: another library's, or a user's own code without Traverse.
    """

    name: str
    call: Callable[[], object]
    n: int = 1
    is_peer: bool = False


@dataclass(frozen=True, slots=True)
class Table:
    """Tasks of one kind and their durations, round by round.

    Attributes:
        times_s: for each, the seconds a pose (sample, ...) of every round.
        peers: names of those that are others'.
    """

    title: str
    times_s: dict[str, list[float]]
    peers: tuple[str, ...]

    @property
    def reference(self) -> str:
        """The fastest peer; the first of all where there is none."""
        names = self.peers or tuple(self.times_s)[:1]
        return min(names, key=lambda name: statistics.median(self.times_s[name]))

    def ratios(self, name: str) -> tuple[float, float, float]:
        """How many times faster than the reference: median, 10 % and 90 %."""
        quotients = np.divide(self.times_s[self.reference], self.times_s[name])
        low, middle, high = np.percentile(quotients, (10, 50, 90))
        return float(middle), float(low), float(high)

    def lines(self, unit: str = "ns", scale: float = 1e9) -> list[str]:
        lines = [self.title]
        for name, taken_s in self.times_s.items():
            low, middle, high = np.percentile(taken_s, (10, 50, 90)) * scale
            ratio, least, most = self.ratios(name)
            mark = "*" if name in self.peers else " "
            lines.append(
                f" {mark}{name:24} {middle:11.1f} {unit} ({low:.1f} to {high:.1f}); "
                f"{ratio:8.2f} times {self.reference} ({least:.2f} to {most:.2f})"
            )
        return lines


def timed(title: str, tasks: Sequence[Task], rounds: int = ROUNDS) -> Table:
    """Time all tasks in turn; the garbage is collected between, not within."""
    repeats = {task.name: _repeats(task) for task in tasks}
    times_s: dict[str, list[float]] = {task.name: [] for task in tasks}
    gc.collect()
    gc.disable()
    try:
        for _ in range(rounds):
            for task in tasks:
                taken_s = _once_s(task, repeats[task.name])
                times_s[task.name].append(taken_s / task.n)
            gc.collect()
    finally:
        gc.enable()
    peers = tuple(task.name for task in tasks if task.is_peer)
    return Table(title, times_s, peers)


def _once_s(task: Task, repeats: int) -> float:
    call = task.call
    begun_s = time.process_time()
    for _ in range(repeats):
        call()
    return (time.process_time() - begun_s) / repeats


def _repeats(task: Task) -> int:
    task.call()  # what is compiled or made ready at the first call
    return max(1, round(ROUND_S / max(1e-9, _once_s(task, 1))))


def one_core() -> None:
    """Stay on one core: all figures are a core's."""
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})


def load() -> str:
    return f"load {os.getloadavg()[0]:.2f} on {os.cpu_count()} cores"


def write_json(path: Path | None, values: object) -> None:
    if path is not None:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(values, indent=1) + "\n", "utf-8")


def report(tables: Iterable[Table], path: Path | None) -> None:
    """Time on one core and print; keep the tables in a file where one is named."""
    one_core()
    print(load())
    written_tables = []
    for table in tables:
        print("\n".join(table.lines()), flush=True)
        written_tables.append(table)
    print(load())
    if path is not None:
        write(written_tables, path)


def write(tables: Sequence[Table], path: Path) -> None:
    """Keep the results as pyperf does, each round a value."""
    benchmarks = []
    for table in tables:
        for name, taken_s in table.times_s.items():
            metadata = {
                "name": f"{table.title} / {name}",
                "table": table.title,
                "who": name,
                "peer": int(name in table.peers),
            }
            run = pyperf.Run(taken_s, metadata=metadata)
            benchmarks.append(pyperf.Benchmark([run]))
    path.parent.mkdir(parents=True, exist_ok=True)
    pyperf.BenchmarkSuite(benchmarks).dump(str(path), replace=True)
