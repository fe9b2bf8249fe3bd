"""`python -m benchmarks.tools.compare FOLDER`: figures worse than the last release's.

FOLDER holds the files of `make bench`. Every headline figure is a ratio to its peer in
the same run: other libraries, a plain loop, a plain script, the board that rests, the
simulator that sends the stream, a bare interpreter. `--keep` stores them for the next
release; else they are compared with the stored ones. Worse is what lies by a tenth
beyond the stored median and outside of the spread of both.

Ratios depend on the machine, too: caches, cores, what else runs. So those of another
machine, or of one that was busy, are not comparable, and printed as such. Exit status
1: something got worse on the same machine.
"""

import argparse
import hashlib
import json
import os
import platform
import sys
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path

import numpy as np

from benchmarks.tools.plots import press_ratios, tables
from benchmarks.tools.rounds import write_json
from benchmarks.tools.sizes import IS_TINY

STORED = Path(__file__).parent / "figures-of-the-last-release.json"
_NOTICEABLE = 0.1
# Runnable programs for each core, on average over the last minutes. The benchmarks
# themselves keep up to two cores busy.
_BUSY = 1.5


@dataclass(frozen=True, slots=True)
class Figure:
    """A ratio to a peer: median, and where most of the rounds lie.

    Attributes:
        peer: the ratio's denominator.
    """

    peer: str
    median: float
    low: float
    high: float
    larger_is_better: bool = False

    def is_worse_than(self, before: "Figure") -> bool:
        if self.larger_is_better:
            floor = before.median / (1.0 + _NOTICEABLE)
            return self.median < floor and self.high < before.low
        ceiling = before.median * (1.0 + _NOTICEABLE)
        return self.median > ceiling and self.low > before.high

    def __str__(self) -> str:
        return f"{self.median:.3g} ({self.low:.3g} to {self.high:.3g})"


def headlines(folder: Path) -> dict[str, Figure]:
    """Read the headline figures of a run.

    Raises:
        FileNotFoundError: a file of the run is missing.
    """
    return {
        name: figure
        for figures in (
            _of_tables(folder / "kinematics.json"),
            _of_tables(folder / "path.json"),
            _of_presses(folder / "presses.json"),
            _of_streams(folder / "streams.json"),
        )
        for name, figure in figures
    }


def _of_tables(path: Path) -> Iterator[tuple[str, Figure]]:
    """The fastest of ours in each table with a peer, against its fastest peer."""
    for table, names in tables(path).items():
        whose = {name: is_peer for name, (_, is_peer) in names.items()}
        if len(set(whose.values())) < 2:
            continue
        times_s = {name: np.array(values) for name, (values, _) in names.items()}
        best = {
            is_peer: min(
                (name for name in names if whose[name] == is_peer),
                key=lambda name: np.median(times_s[name]),
            )
            for is_peer in (False, True)
        }
        ratios = times_s[best[True]] / times_s[best[False]]
        yield (
            f"{table}: times faster",
            _figure(ratios.tolist(), best[True], larger_is_better=True),
        )


def _of_presses(path: Path) -> Iterator[tuple[str, Figure]]:
    for rate_hz, ratios in press_ratios(path).items():
        for name, values in ratios.items():
            label = f"{rate_hz:.0f} presses/s, {name}: times"
            yield label, _figure(values, "the plain script")


def _of_streams(path: Path) -> Iterator[tuple[str, Figure]]:
    values = json.loads(path.read_text("utf-8"))
    streams = values["streams"]
    for rate_hz in sorted({stream["rate_hz"] for stream in streams}):
        chosen = [stream for stream in streams if stream["rate_hz"] == rate_hz]
        ratios = [
            stream["daemon_share"] / stream["simulator_share"] for stream in chosen
        ]
        yield f"{rate_hz:.0f} Hz: times the CPU", _figure(ratios, "the simulator")
    for moves in (False, True):
        chosen = [run for run in values["idle"] if run["moves"] is moves]
        ratios = [run["daemon_share"] / run["board_share"] for run in chosen]
        label = f"idle, the arm {'moves' if moves else 'rests'}: times the CPU"
        yield label, _figure(ratios, "the simulator" if moves else "the board")
    ready = [stream["ready_s"] / values["bare_start_s"] for stream in streams]
    yield "start: times as long", _figure(ready, "an interpreter with numpy")
    memory = [stream["memory_mb"] / values["bare_memory_mb"] for stream in streams]
    yield "memory: times as much", _figure(memory, "an interpreter with numpy")


def _figure(
    ratios: list[float], peer: str, *, larger_is_better: bool = False
) -> Figure:
    low, middle, high = np.percentile(ratios, (10, 50, 90)).tolist()
    return Figure(peer, middle, low, high, larger_is_better)


def machine() -> dict[str, str]:
    """Identify the machine: the host, its processor, the interpreter."""
    cpu = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.exists():
        models = [
            line for line in info.read_text().splitlines() if "model name" in line
        ]
        cpu = models[0].partition(":")[2].strip() if models else cpu
    return {
        "host": hashlib.sha256(_host_id().encode()).hexdigest()[:12],
        "cpu": cpu,
        "cores": str(os.cpu_count()),
        "python": platform.python_version(),
    }


def _host_id() -> str:
    """Return systemd's identity of the installation, or the host's name."""
    for path in (Path("/etc/machine-id"), Path("/var/lib/dbus/machine-id")):
        if path.exists() and (text := path.read_text().strip()):
            return text
    return platform.node()


def not_comparable(
    now: Mapping[str, str], kept: Mapping[str, str] | None, load: float
) -> str:
    """Say why figures cannot be compared with the stored ones; empty: they can."""
    if IS_TINY:
        return "sizes were tiny"
    if kept is None:
        return "the stored figures name no machine"
    other = [
        f"{key} {kept.get(key)}, here {now[key]}"
        for key in now
        if kept.get(key) != now[key]
    ]
    if other:
        return f"they are of another machine: {'; '.join(other)}"
    if load > _BUSY:
        return f"this machine is busy: load {load:.1f} a core, at most {_BUSY}"
    return ""


def report(
    now: dict[str, Figure], before: dict[str, Figure], reason: str = ""
) -> tuple[list[str], int]:
    """Compare; lines for people, and how many figures got worse."""
    lines, n_worse = [], 0
    for name in sorted({*now, *before}):
        if name not in now or name not in before:
            where = "this run" if name in before else "the last release"
            lines.append(f"  {name}: not in {where}")
            continue
        is_worse = now[name].is_worse_than(before[name])
        is_better = before[name].is_worse_than(now[name])
        word = "WORSE: " if is_worse else "better: " if is_better else ""
        if reason or now[name].peer != before[name].peer:
            word = "not comparable: "
        n_worse += word == "WORSE: "
        lines.append(
            f"  {word}{name} {now[name].peer}: {now[name]}, was {before[name]}"
        )
    return lines, n_worse


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.tools.compare")
    parser.add_argument("folder", type=Path, help="what make bench wrote")
    parser.add_argument("--kept", type=Path, default=STORED, help="stored figures")
    parser.add_argument(
        "--keep", action="store_true", help="store, for the next release"
    )
    arguments = parser.parse_args()
    try:
        now = headlines(arguments.folder)
    except FileNotFoundError as error:
        print(f"{error.filename}: missing; run make bench first", file=sys.stderr)
        return 2
    this_machine = machine()
    if arguments.keep:
        values = {
            "version": version("traverse-cmm"),
            "machine": this_machine,
            "figures": {name: asdict(figure) for name, figure in now.items()},
        }
        write_json(arguments.kept, values)
        print(f"{len(now)} figures kept in {arguments.kept.name}")
        return 0
    stored = json.loads(arguments.kept.read_text("utf-8"))
    before = {name: Figure(**values) for name, values in stored["figures"].items()}
    load = os.getloadavg()[1] / (os.cpu_count() or 1)
    reason = not_comparable(this_machine, stored.get("machine"), load)
    lines, n_worse = report(now, before, reason)
    print(f"Ratios to peers, beside those of {stored['version']}:", *lines, sep="\n")
    if reason:
        print(f"not comparable: {reason}")
    else:
        print(f"{n_worse} of {len(now)} got worse")
    return 1 if n_worse else 0


if __name__ == "__main__":
    sys.exit(main())
