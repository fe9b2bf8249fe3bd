"""Messages that may be missed: live poses, events, states, blocks of scans.

Each reader has a bounded queue; messages beyond it are counted.
"""

import asyncio
import weakref
from collections import deque
from collections.abc import Awaitable, Callable
from typing import Generic, Self, TypeVar

from traverse.client.change_signal import ChangeSignal
from traverse.client.results import StartedScan
from traverse.protocol.messages import Scan

T = TypeVar("T")


class Feed(Generic[T]):
    """Messages of one kind as they arrive, for one reader: use with `async for`.

    Args:
        keep_newest: drop the oldest beyond it, otherwise the newest.
        prepare: makes of a message what is handed on, at that moment.

    Attributes:
        missed: messages for which there was no room.
    """

    def __init__(
        self,
        limit: int,
        *,
        keep_newest: bool,
        prepare: Callable[[T], T] = lambda message: message,
    ) -> None:
        self._prepare = prepare
        self._waiting: deque[T] = deque()
        self._limit = limit
        self._keep_newest = keep_newest
        self._changed = ChangeSignal()
        self._error: BaseException | None = None
        self._is_closed = False
        self.missed = 0

    def put(self, message: T) -> None:
        if len(self._waiting) >= self._limit:
            self.missed += 1
            if not self._keep_newest:
                return
            self._waiting.popleft()
        self._waiting.append(message)
        self._changed.notify()

    def close(self, error: BaseException | None = None) -> None:
        """End the iteration; the reader gets the reason, if there is one."""
        self._is_closed, self._error = True, error
        self._changed.notify()

    def __aiter__(self) -> Self:
        return self

    async def __anext__(self) -> T:
        while not self._waiting:
            if self._error is not None:
                raise self._error
            if self._is_closed:
                raise StopAsyncIteration
            await self._changed.wait()
        return self._prepare(self._waiting.popleft())


class Feeds(Generic[T]):
    """All readers of one kind of message; unreferenced ones are removed.

    Args:
        new_feed: makes the feed of a reader.
    """

    def __init__(self, new_feed: Callable[[], Feed[T]]) -> None:
        self._new_feed = new_feed
        self._feeds: weakref.WeakSet[Feed[T]] = weakref.WeakSet()
        self._changed = ChangeSignal()
        self._end: tuple[BaseException | None] | None = None
        self.latest: T | None = None

    def open(self) -> Feed[T]:
        feed = self._new_feed()
        if self._end is not None:
            feed.close(*self._end)
        self._feeds.add(feed)
        return feed

    def put(self, message: T) -> None:
        self.latest = message
        for feed in list(self._feeds):
            feed.put(message)
        self._changed.notify()

    def close(self, error: BaseException | None = None) -> None:
        self._end = (error,)
        for feed in list(self._feeds):
            feed.close(error)
        self._changed.notify()

    async def first(self, seconds: float) -> T:
        """Return the latest message, or wait for the first.

        Raises:
            TimeoutError: none arrived within this time.
        """
        async with asyncio.timeout(seconds):
            while self.latest is None:
                if self._end is not None and self._end[0] is not None:
                    raise self._end[0]
                await self._changed.wait()
        return self.latest


class ScanBlocks:
    """Blocks of a scan that runs within the `async with`; use with `async for`.

    Iteration ends with the scan: at the end of the block, when another client stops it,
    or when another scan replaces it. Repeated blocks, possible after an outage, are
    dropped.

    Args:
        follow: subscribes to blocks of scans, and yields them.

    Attributes:
        missing: points that did not arrive, by the gaps in their numbers.
    """

    def __init__(
        self,
        follow: Callable[[], Awaitable[Feed[Scan]]],
        start: Callable[[], Awaitable[StartedScan]],
        stop: Callable[[], Awaitable[None]],
    ) -> None:
        self._follow = follow
        self._start = start
        self._stop = stop
        self._feed: Feed[Scan] | None = None
        self._next_seq = 0
        self._has_ended = False
        self._scan: StartedScan | None = None
        self.missing = 0

    @property
    def scan(self) -> StartedScan:
        if self._scan is None:
            raise RuntimeError("the scan has not begun; use it with `async with`")
        return self._scan

    async def __aenter__(self) -> Self:
        self._feed = await self._follow()
        self._scan = await self._start()
        return self

    async def __aexit__(self, *raised: object) -> None:
        self._feed = None
        if not self._has_ended:
            await self._stop()

    def __aiter__(self) -> Self:
        return self

    async def __anext__(self) -> Scan:
        if self._feed is None or self._has_ended:
            raise StopAsyncIteration
        async for block in self._feed:
            if block.scan != self.scan.scan:
                continue
            if block.seq < self._next_seq:
                continue
            self._has_ended = block.last
            self.missing += block.seq - self._next_seq
            self._next_seq = block.seq + len(block.dtime_ns)
            return block
        raise StopAsyncIteration
