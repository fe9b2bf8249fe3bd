"""Parallel work, by processes of this computer or by a Dask cluster.

A worker may die, of memory or with its computer; another repeats its work. Results of a
task whose workers died several times are marked as such.
"""

import logging
import os
import platform
import re
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import (
    FIRST_COMPLETED,
    CancelledError,
    Executor,
    Future,
    ProcessPoolExecutor,
    wait,
)
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.metadata import version
from itertools import islice
from multiprocessing import get_context
from time import monotonic
from typing import TypeVar

Given = TypeVar("Given")
Made = TypeVar("Made")

_PACKAGE = "traverse-cmm"
_MOST_DEATHS = 3
_ADDRESS = re.compile(r"(tcp://|tls://)?[^\s:/]+:\d+")
_EXPECTED = "expected one such as tcp://host:8786"
_WENT_AWAY = "the Dask scheduler went away; what was done stays"
_CONNECT_S = 10.0
# A cluster without any worker for so long does not get one.
_NO_WORKERS_S = 60.0
_LOOK_S = 2.0
# Submitted for each worker, so that none is idle.
_AHEAD = 2


class WorkersError(RuntimeError):
    """The cluster cannot be used, or went away."""


class WorkerDiedError(RuntimeError):
    """Several workers died while they computed the same item."""


@dataclass(frozen=True, slots=True)
class Workers:
    """Processes of this computer, or a cluster.

    Attributes:
        processes: Of this computer; None: as many as it has cores.
        scheduler: Address of a Dask scheduler, instead.
    """

    processes: int | None = None
    scheduler: str | None = None

    def each(
        self, function: Callable[[Given], Made], items: Iterable[Given]
    ) -> Iterator[tuple[Given, Made | WorkerDiedError]]:
        """Apply a module's function to each item; yield results as they end.

        Items are fetched as workers become free.

        Raises:
            WorkersError: The cluster cannot be used, or went away.
        """
        waiting = ((item, 0) for item in items)
        suspects: deque[tuple[Given, int]] = deque()
        is_over = False
        while not is_over:
            going: dict[Future[Made], tuple[Given, int]] = {}
            with self._pool() as pool:
                while True:
                    # After a death one at a time, to see whose it was.
                    is_single = suspects or any(deaths for _, deaths in going.values())
                    free = (1 if is_single else _AHEAD * pool.n_workers()) - len(going)
                    source = drained(suspects) if suspects else waiting
                    for entry in islice(source, max(free, 0)):
                        going[_submitted(pool.executor, function, entry[0])] = entry
                    if not going:
                        is_over = True
                        break
                    ended = wait(going, _LOOK_S, FIRST_COMPLETED).done
                    if any(_is_broken(future) for future in ended):
                        break
                    for future in ended:
                        result = _result(future, pool.deaths)
                        yield going.pop(future)[0], result
            for future, (item, deaths) in going.items():
                if not _is_broken(future):
                    yield item, future.result()
                elif deaths + 1 == _MOST_DEATHS:
                    yield item, _died()
                else:
                    suspects.append((item, deaths + 1))

    @contextmanager
    def _pool(self) -> "Iterator[_Pool]":
        if self.scheduler is not None:
            with _cluster(self.scheduler) as pool:
                yield pool
            return
        # Many small matrices: threads of the linear algebra would be in the way.
        os.environ["OPENBLAS_NUM_THREADS"] = "1"
        n = self.processes or os.cpu_count() or 1
        with ProcessPoolExecutor(n, mp_context=get_context("spawn")) as executor:
            try:
                yield _Pool(executor, lambda: n)
            except BaseException:
                executor.shutdown(wait=True, cancel_futures=True)
                raise


def _died() -> WorkerDiedError:
    return WorkerDiedError(f"{_MOST_DEATHS} workers died while they did it")


def drained(queue: deque[Given]) -> Iterator[Given]:
    while queue:
        yield queue.popleft()


def _submitted(
    executor: Executor, function: Callable[[Given], Made], item: Given
) -> Future[Made]:
    try:
        return executor.submit(function, item)
    except BrokenProcessPool as error:
        failed: Future[Made] = Future()
        failed.set_exception(error)
        return failed


def _is_broken(future: "Future[Made]") -> bool:
    if future.cancelled():
        return False
    return isinstance(future.exception(), BrokenProcessPool)


@dataclass(frozen=True, slots=True)
class _Pool:
    """An executor, its current number of workers, and errors of dead ones."""

    executor: Executor
    n_workers: Callable[[], int]
    deaths: tuple[type[Exception], ...] = ()


def _result(
    future: "Future[Made]", deaths: tuple[type[Exception], ...]
) -> Made | WorkerDiedError:
    """Return the results.

    Raises:
        WorkersError: The cluster went away.
    """
    try:
        return future.result()
    except deaths:
        return _died()
    except CancelledError as error:
        raise WorkersError(_WENT_AWAY) from error


def _versions() -> str:
    return ", ".join(
        [
            f"Python {platform.python_version()}",
            *(f"{name} {version(name)}" for name in (_PACKAGE, "numpy", "scipy")),
        ]
    )


@contextmanager
def _cluster(address: str) -> Iterator[_Pool]:
    # An extra.
    from distributed import Client, KilledWorker  # noqa: PLC0415

    if not _ADDRESS.fullmatch(address):
        raise WorkersError(f"{address} is no address of a Dask scheduler; {_EXPECTED}")
    # It says in tracebacks what is told below in a sentence.
    for name in ("distributed", "distributed.client"):
        logging.getLogger(name).setLevel(logging.CRITICAL)
    try:
        client = Client(address, timeout=_CONNECT_S, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        raise WorkersError(
            f"{address}: no Dask scheduler there; {_EXPECTED}"
        ) from error
    with client, client.get_executor(pure=False) as executor:
        seen_s = monotonic()

        def n_workers() -> int:
            nonlocal seen_s
            try:
                threads = client.nthreads()
            except (OSError, CancelledError) as error:
                raise WorkersError(_WENT_AWAY) from error
            if threads:
                seen_s = monotonic()
            elif monotonic() - seen_s > _NO_WORKERS_S:
                lack = f"no worker for {_NO_WORKERS_S:.0f} s; start some"
                raise WorkersError(f"{address}: {lack}: `dask worker {address}`")
            return max(sum(map(int, threads.values())), 1)

        try:
            their_versions = set(client.run(_versions).values())
        except ImportError as error:
            raise WorkersError(f"{address}: workers lack Traverse: {error}") from error
        for versions in their_versions - {_versions()}:
            raise WorkersError(
                f"{address}: a worker has {versions}; here it is {_versions()}: "
                "results would differ"
            )
        yield _Pool(executor, n_workers, (KilledWorker,))
