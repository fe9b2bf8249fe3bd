"""Trials of one kind, numbered by seeds, and how workers run them."""

import math
import time
import traceback
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby, takewhile, zip_longest
from typing import Any, Generic, TypeVar

from benchmarks.trials.lines import Line
from traverse.fleet.workers import WorkerDiedError, Workers

Case = TypeVar("Case")
Batch = tuple["Series[Any]", tuple[int, ...]]


@dataclass(frozen=True, slots=True)
class Series(Generic[Case]):
    """Trials of one scenario.

    Functions and their bound arguments travel to workers: functions of a module, or
    `functools.partial` of them.

    Attributes:
        scenario: Name; with the seed it identifies a trial.
        draw: Makes a case from a seed, and from nothing else.
        run: Returns its outcome as values that JSON can hold.
        n: Number of trials where the user does not choose.
        first: The first seed where the user does not choose.
        batch: Trials with consecutive seeds that one worker runs one after another,
            because they share an expensive preparation.
    """

    scenario: str
    draw: Callable[[int], Case]
    run: Callable[[Case], Line]
    n: int = 1
    batch: int = 1
    first: int = 0

    def trial(self, seed: int) -> Line:
        """Draw and run; an exception is recorded as the outcome."""
        line: Line = {"scenario": self.scenario, "seed": seed, "error": None}
        begun_s = time.monotonic()
        try:
            line |= _plain(self.run(self.draw(seed)))
        except Exception:  # noqa: BLE001 - a trial that breaks is a result too
            line["error"] = traceback.format_exc()
        line["seconds_in_all"] = time.monotonic() - begun_s
        return line

    def batches(self, seeds: Sequence[int]) -> Iterator[Batch]:
        """Group seeds for workers: those between two multiples of the batch."""
        for _, together in groupby(seeds, lambda seed: seed // self.batch):
            yield self, tuple(together)


def executed(
    workers: Workers,
    seeds_of_series: Iterable[tuple[Series[Any], Sequence[int]]],
    is_time_left: Callable[[], bool] = lambda: True,
) -> Iterator[list[Line]]:
    """Run trials, series in turns; yield the lines of every batch as it ends.

    Raises:
        WorkersError: The cluster cannot be used, or went away.
    """
    by_series = [list(series.batches(seeds)) for series, seeds in seeds_of_series]
    turns = (
        batch for turn in zip_longest(*by_series) for batch in turn if batch is not None
    )
    in_time = takewhile(lambda _: is_time_left(), turns)
    for (series, seeds), lines in workers.each(_run_batch, in_time):
        if isinstance(lines, WorkerDiedError):
            yield [_died(series.scenario, seed, lines) for seed in seeds]
        else:
            yield lines


def _run_batch(batch: Batch) -> list[Line]:
    series, seeds = batch
    return [series.trial(seed) for seed in seeds]


def _died(scenario: str, seed: int, error: WorkerDiedError) -> Line:
    line: Line = {"scenario": scenario, "seed": seed, "error": str(error)}
    return {**line, "seconds_in_all": 0.0}


def _plain(value: Any) -> Any:  # noqa: ANN401 - what JSON can hold
    """Replace a NaN by None and a tuple by a list, as JSON has neither."""
    if isinstance(value, dict):
        return {key: _plain(part) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(part) for part in value]
    return None if isinstance(value, float) and math.isnan(value) else value
