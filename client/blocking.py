"""An arm for programs without asyncio: scripts and notebooks."""

import asyncio
import contextlib
import functools
import threading
from collections.abc import AsyncIterator, Callable, Coroutine, Iterator, Mapping
from concurrent.futures import Future
from pathlib import Path
from typing import (
    Any,
    Concatenate,
    Generic,
    Literal,
    ParamSpec,
    Self,
    TypedDict,
    TypeVar,
    Unpack,
)

from traverse.broker.address import BrokerAddress
from traverse.client.arm import Arm
from traverse.client.cancel_tasks import cancel_tasks
from traverse.client.commands import ScanOptions
from traverse.client.errors import Counters
from traverse.client.points.session_order import Lost
from traverse.protocol.messages import Event, Live, Point, Scan
from traverse.protocol.messages.scan import ScanMode

P = ParamSpec("P")
T = TypeVar("T")


class LoopThread:
    """An event loop in a thread of its own."""

    def __init__(self) -> None:
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(
            target=self._loop.run_forever, name="arm-client", daemon=True
        )
        self._thread.start()

    def submit(self, work: Coroutine[Any, Any, T]) -> Future[T]:
        return asyncio.run_coroutine_threadsafe(work, self._loop)

    def run(self, work: Coroutine[Any, Any, T]) -> T:
        future = self.submit(work)
        try:
            return future.result()
        except BaseException:
            future.cancel()
            raise

    def close(self) -> None:
        self.run(self._clear())
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()

    async def _clear(self) -> None:
        current_task = asyncio.current_task()
        await cancel_tasks(
            task for task in asyncio.all_tasks() if task is not current_task
        )
        await self._loop.shutdown_default_executor()


class AsyncSource(Generic[T]):
    """Items of an asynchronous iterator, one after the other.

    A wait that was interrupted (Ctrl-C) or timed out loses nothing: the next one
    continues with it.
    """

    def __init__(self, loop: LoopThread, items: AsyncIterator[T]) -> None:
        self._loop = loop
        self._items = items
        self._waiting: Future[T] | None = None

    def next(self, idle_timeout_s: float | None) -> T:
        """Wait for the next item.

        Raises:
            TimeoutError: none arrived within this time.
            StopAsyncIteration: none will follow.
        """
        waiting = self._waiting = self._waiting or self._loop.submit(self._next())
        try:
            return waiting.result(idle_timeout_s)
        finally:
            if waiting.done():
                self._waiting = None

    async def _next(self) -> T:
        return await anext(self._items)


class TimedIterator(Generic[T]):
    """A source for a `for` loop.

    Args:
        idle_timeout_s: time without an item that ends the iteration; None: never.
    """

    def __init__(self, source: AsyncSource[T], idle_timeout_s: float | None) -> None:
        self._source = source
        self._idle_timeout_s = idle_timeout_s

    def __iter__(self) -> Self:
        return self

    def __next__(self) -> T:
        try:
            return self._source.next(self._idle_timeout_s)
        except (TimeoutError, StopAsyncIteration):
            raise StopIteration from None


class ArmOptions(TypedDict, total=False):
    """Options of `Arm`, which explains them."""

    since: Literal["now", "session", "beginning"] | Mapping[str, int]
    cursor_file: Path | str | None
    connect_timeout_s: float
    reply_timeout_s: float
    max_waiting: int


def _waited(
    method: Callable[Concatenate[Arm, P], Coroutine[Any, Any, T]],
) -> Callable[Concatenate["BlockingArm", P], T]:
    """Wrap a method of `Arm` to return when its work is done."""

    @functools.wraps(method)
    def waiting(self: "BlockingArm", /, *args: P.args, **options: P.kwargs) -> T:
        return self._running().run(method(self._arm, *args, **options))

    return waiting


class BlockingArm:
    """An arm behind a broker; use with `with`.

    A thread runs the loop of an `Arm`, whose methods are called and waited for.
    Iterators end when nothing has arrived for ``idle_timeout_s``, or never.

    Args:
        name, broker, options: as of `Arm`.
    """

    def __init__(
        self,
        name: str,
        broker: str | BrokerAddress = "localhost",
        **options: Unpack[ArmOptions],
    ) -> None:
        self._arm = Arm(name, broker, **options)
        self._loop: LoopThread | None = None
        self._points: AsyncSource[Point | Lost] | None = None

    def __enter__(self) -> Self:
        loop = LoopThread()
        try:
            loop.run(self._arm.__aenter__())
        except BaseException:
            loop.close()
            raise
        self._loop = loop
        self._points = AsyncSource(loop, self._arm.points_and_losses())
        return self

    def __exit__(self, *raised: object) -> None:
        loop = self._running()
        self._loop = None
        try:
            loop.run(self._arm.__aexit__(*raised))
        finally:
            loop.close()

    @property
    def cursor(self) -> dict[str, int]:
        return self._arm.cursor

    @property
    def counters(self) -> Counters:
        return self._arm.counters

    @property
    def is_connected(self) -> bool:
        return self._arm.is_connected

    @property
    def absence(self) -> str:
        return self._arm.absence

    def points(self, idle_timeout_s: float | None = None) -> Iterator[Point]:
        for item in self.points_and_losses(idle_timeout_s):
            if isinstance(item, Point):
                yield item

    def points_and_losses(
        self, idle_timeout_s: float | None = None
    ) -> TimedIterator[Point | Lost]:
        """Iterate as `points`, with a `Lost` in the place of unavailable points."""
        self._running()
        if self._points is None:
            raise RuntimeError("the arm was never opened")
        return TimedIterator(self._points, idle_timeout_s)

    def events(self, idle_timeout_s: float | None = None) -> TimedIterator[Event]:
        return self._items(_call_in_loop(self._arm.events), idle_timeout_s)

    def live(self, idle_timeout_s: float | None = None) -> TimedIterator[Live]:
        """Iterate over latest poses."""
        return self._items(_call_in_loop(self._arm.live), idle_timeout_s)

    def scans(self, idle_timeout_s: float | None = None) -> TimedIterator[Scan]:
        return self._items(self._arm.scans(), idle_timeout_s)

    @contextlib.contextmanager
    def scan(
        self,
        mode: ScanMode = "time",
        *,
        idle_timeout_s: float | None = None,
        **options: Unpack[ScanOptions],
    ) -> Iterator[TimedIterator[Scan]]:
        """Run a scan within a `with` block; iterate over its blocks."""
        loop = self._running()
        blocks = self._arm.scan(mode, **options)
        loop.run(blocks.__aenter__())
        try:
            yield TimedIterator(AsyncSource(loop, blocks), idle_timeout_s)
        finally:
            loop.run(blocks.__aexit__(None, None, None))

    status = _waited(Arm.status)
    health = _waited(Arm.health)
    capture = _waited(Arm.capture)
    undo = _waited(Arm.undo)
    label = _waited(Arm.label)
    probe = _waited(Arm.probe)
    confirm_reference = _waited(Arm.confirm_reference)
    home = _waited(Arm.home)
    reload = _waited(Arm.reload)
    align = _waited(Arm.align)
    clear_alignment = _waited(Arm.clear_alignment)
    new_session = _waited(Arm.new_session)
    covariance = _waited(Arm.covariance)
    distance = _waited(Arm.distance)
    sessions = _waited(Arm.sessions)
    start_scan = _waited(Arm.start_scan)
    stop_scan = _waited(Arm.stop_scan)
    resend = _waited(Arm.resend)
    resend_scan = _waited(Arm.resend_scan)
    execute = _waited(Arm.execute)

    def _items(
        self,
        opening: Coroutine[Any, Any, AsyncIterator[T]],
        idle_timeout_s: float | None,
    ) -> TimedIterator[T]:
        loop = self._running()
        return TimedIterator(AsyncSource(loop, loop.run(opening)), idle_timeout_s)

    def _running(self) -> LoopThread:
        if self._loop is None:
            raise RuntimeError("the arm is not open; use it with `with`")
        return self._loop


async def _call_in_loop(make: Callable[[], T]) -> T:
    return make()
