"""An event loop in a thread, and its iterators for those who have no loop."""

import asyncio
import threading
from collections.abc import AsyncIterator, Coroutine
from concurrent.futures import Future
from typing import Any, Generic, Self, TypeVar

from traverse.client.cancel_tasks import end

T = TypeVar("T")


class LoopThread:
    """An event loop in a thread of its own."""

    def __init__(self) -> None:
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(
            target=self._loop.run_forever, name="arm-client", daemon=True
        )
        self._thread.start()

    def start(self, work: Coroutine[Any, Any, T]) -> Future[T]:
        """Begin something; its result can be waited for."""
        return asyncio.run_coroutine_threadsafe(work, self._loop)

    def do(self, work: Coroutine[Any, Any, T]) -> T:
        """Do something and wait for it; it is given up if the wait is interrupted."""
        future = self.start(work)
        try:
            return future.result()
        except BaseException:
            future.cancel()
            raise

    def close(self) -> None:
        """End the loop and its thread."""
        self.do(self._clear())
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()

    async def _clear(self) -> None:
        here = asyncio.current_task()
        await end(task for task in asyncio.all_tasks() if task is not here)
        await self._loop.shutdown_default_executor()


class Source(Generic[T]):
    """What an asynchronous iterator gives, one after the other.

    A wait that was interrupted (Ctrl-C) or took too long loses nothing: the next one
    goes on with it.

    Args:
        loop: on which it runs.
        items: the iterator.
    """

    def __init__(self, loop: LoopThread, items: AsyncIterator[T]) -> None:
        self._loop = loop
        self._items = items
        self._waiting: Future[T] | None = None

    def next(self, quiet_s: float | None) -> T:
        """Wait for the next one.

        Raises:
            TimeoutError: none came within this time.
            StopAsyncIteration: none will come any more.
        """
        waiting = self._waiting = self._waiting or self._loop.start(self._next())
        try:
            return waiting.result(quiet_s)
        finally:
            if waiting.done():
                self._waiting = None

    async def _next(self) -> T:
        return await anext(self._items)


class Items(Generic[T]):
    """A source for a `for` loop.

    Args:
        source: of the items.
        quiet_s: iteration ends when nothing has come for so long; None: never.
    """

    def __init__(self, source: Source[T], quiet_s: float | None) -> None:
        self._source = source
        self._quiet_s = quiet_s

    def __iter__(self) -> Self:
        return self

    def __next__(self) -> T:
        try:
            return self._source.next(self._quiet_s)
        except (TimeoutError, StopAsyncIteration):
            raise StopIteration from None
