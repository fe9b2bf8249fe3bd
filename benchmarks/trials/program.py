"""The command line that all programs of trials share."""

import argparse
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.tools.sizes import IS_TINY, sized
from benchmarks.trials.lines import FOLDERS, Line, append, code_version, stored
from benchmarks.trials.series import Series, executed
from traverse.fleet.workers import Workers, WorkersError

_MOST_BROKEN = 30
_PROGRESS_S = 10.0


@dataclass(frozen=True, slots=True)
class Verdict:
    """Tables for people, and whether everything that they should show holds."""

    text: str
    holds: bool


@dataclass(frozen=True, slots=True)
class Program:
    """One program of trials.

    Attributes:
        name: Its module, as after `python -m`.
        series: Makes the series that the user asks for.
        judge: Judges the outcomes of all series, in their order.
        paint: Writes pictures of the outcomes into a folder.
        folders: With the code that outcomes depend on.
    """

    name: str
    series: Callable[[argparse.Namespace], Sequence[Series[Any]]]
    judge: Callable[[Sequence[Line]], Verdict]
    add_arguments: Callable[[argparse.ArgumentParser], None] | None = None
    paint: Callable[[Sequence[Line], Path], None] | None = None
    folders: Sequence[str] = FOLDERS

    @property
    def out(self) -> Path:
        """The file where the user names none."""
        return Path("build") / f"{self.name.removeprefix('benchmarks.')}.jsonl"

    def main(self, arguments: Sequence[str] | None = None) -> int:
        """Run the trials that its file lacks, judge all; 1 if anything fails to hold.

        Status 2: the workers cannot be used.
        """
        options = self._parser().parse_args(arguments)
        begun_s = time.monotonic()
        counts = chosen_seeds(self.series(options), options)
        # At the beginning: the code on the disk may change meanwhile.
        version = code_version(self.folders)
        lines, n_other = _kept(
            options.out, counts, None if options.any_code else version
        )
        if n_other:
            print(
                f"{options.out}: {n_other} trials were made by other code and do not "
                "count; --any-code takes them"
            )
        done = {(line["scenario"], line["seed"]) for line in lines}
        missing = [
            (series, [seed for seed in seeds if (series.scenario, seed) not in done])
            for series, seeds in counts
        ]
        n_missing = sum(len(seeds) for _, seeds in missing)
        print(f"{options.out}: {len(lines)} trials; {n_missing} to go", flush=True)
        ends_s = begun_s + 60.0 * options.minutes
        workers = Workers(options.processes, options.scheduler)
        try:
            new = executed(workers, missing, lambda: time.monotonic() < ends_s)
            n_done, shown_s = 0, begun_s
            for outcomes in new:
                batch = [{**line, "code": version} for line in outcomes]
                append(options.out, batch)
                lines += batch
                n_done += len(batch)
                if time.monotonic() > shown_s + _PROGRESS_S:
                    shown_s = time.monotonic()
                    print(f"{n_done} of {n_missing}", flush=True)
        except WorkersError as error:
            print(error)
            return 2
        order = {series.scenario: number for number, (series, _) in enumerate(counts)}
        lines.sort(key=lambda line: (order[line["scenario"]], line["seed"]))
        holds = self._report(lines, options)
        print(f"took {time.monotonic() - begun_s:.0f} s")
        return 0 if holds else 1

    def _report(self, lines: Sequence[Line], arguments: argparse.Namespace) -> bool:
        broken = [line for line in lines if line["error"] is not None]
        for line in broken[:_MOST_BROKEN]:
            last = line["error"].strip().splitlines()[-1]
            print(f"broke: {line['scenario']}, seed {line['seed']}: {last}")
        verdict = self.judge(lines)
        print(verdict.text)
        times_s = [line["seconds_in_all"] for line in lines]
        if times_s:
            print(
                f"\n{len(lines)} trials, {len(broken)} broke; one took "
                f"{np.median(times_s):.2f} s, {np.max(times_s):.2f} s at most"
            )
        if self.paint is not None and arguments.pictures is not None:
            arguments.pictures.mkdir(parents=True, exist_ok=True)
            self.paint(lines, arguments.pictures)
        return (verdict.holds or IS_TINY) and not broken

    def _parser(self) -> argparse.ArgumentParser:
        parser = argparse.ArgumentParser(prog=f"python -m {self.name}")
        add = parser.add_argument
        add("--runs", type=int, help="about so many in all, shared among scenarios")
        add("--seeds", type=int, help="at most so many of each scenario")
        add("--seed", type=int, default=0, help="so many are left out first")
        add("--scenarios", nargs="*", default=[], help="parts of names")
        add("--out", type=Path, default=self.out, help="a line each; continued")
        add(
            "--any-code",
            action="store_true",
            help="count trials of the file that other code made",
        )
        add(
            "--minutes",
            type=float,
            default=float("inf"),
            help="begin no trial after that; 0: only judge what the file has",
        )
        add("--processes", type=int, help="of this computer; default all cores")
        add("--scheduler", help="Dask scheduler instead, tcp://HOST:PORT")
        if self.paint is not None:
            add("--pictures", type=Path, help="folder for the pictures")
        if self.add_arguments is not None:
            self.add_arguments(parser)
        return parser


def chosen_seeds(
    series: Sequence[Series[Any]], arguments: argparse.Namespace
) -> list[tuple[Series[Any], range]]:
    """Choose seeds of every series; of few series in tiny sizes."""
    chosen = [
        trials
        for trials in series
        if not arguments.scenarios
        or any(part in trials.scenario for part in arguments.scenarios)
    ]
    chosen = chosen[:: sized(1, max(1, len(chosen) // 2))]
    total = sum(trials.n for trials in chosen)
    counts = []
    for trials in chosen:
        n = sized(trials.n, 1)
        if arguments.runs is not None:
            n = max(1, n * arguments.runs // total)
        if arguments.seeds is not None:
            n = min(n, arguments.seeds)
        first = trials.first + arguments.seed
        counts.append((trials, range(first, first + n)))
    return counts


def _kept(
    path: Path, counts: Sequence[tuple[Series[Any], range]], version: str | None
) -> tuple[list[Line], int]:
    """Read a file's lines of some series, and count those of other code.

    Args:
        path: The file.
        counts: The series.
        version: Of the code that counts; None: any.
    """
    names = {series.scenario for series, _ in counts}
    lines = [line for line in stored(path) if line["scenario"] in names]
    same = [line for line in lines if version in (None, line["code"])]
    latest = {(line["scenario"], line["seed"]): line for line in same}
    return list(latest.values()), len(lines) - len(same)
