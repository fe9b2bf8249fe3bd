"""Proofs on all cores, or on a Dask cluster whose workers see this checkout."""

import argparse
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

from traverse.fleet.workers import WorkerDiedError, Workers

Given = TypeVar("Given")
Made = TypeVar("Made")


def add_workers(parser: argparse.ArgumentParser) -> None:
    """Let the user choose a cluster."""
    parser.add_argument(
        "--scheduler", help="Dask scheduler, tcp://HOST:PORT; default all cores here"
    )


@dataclass(frozen=True)
class _Batch(Generic[Given, Made]):
    """Calls a function with several, numbered; it travels to workers."""

    function: Callable[[Given], Made]

    def __call__(self, batch: Sequence[tuple[int, Given]]) -> list[tuple[int, Made]]:
        return [(number, self.function(one)) for number, one in batch]


def unordered(
    scheduler: str | None, function: Callable[[Given], Made], given: Iterable[Given]
) -> Iterator[Made]:
    """Call a module's function with each; yield what is made as it ends."""
    for _, made in Workers(scheduler=scheduler).each(function, given):
        if isinstance(made, WorkerDiedError):
            raise made
        yield made


def ordered(
    scheduler: str | None,
    function: Callable[[Given], Made],
    given: Iterable[Given],
    at_once: int = 1,
) -> list[Made]:
    """Do the same, in the order of what is given, so many in one call."""
    numbered = list(enumerate(given))
    batches = [numbered[n : n + at_once] for n in range(0, len(numbered), at_once)]
    batch = _Batch[Given, Made](function)
    made = [one for part in unordered(scheduler, batch, batches) for one in part]
    return [one for _, one in sorted(made, key=lambda entry: entry[0])]
