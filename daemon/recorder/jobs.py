"""What the loop asks of the recorder thread, and what it hears from it."""

import asyncio
import contextlib
from collections.abc import Callable
from functools import partial
from typing import TypeVar

from traverse.daemon.recorder.item_queue import Item, RecorderQueue

T = TypeVar("T")


class ThreadJobs:
    """Hands work to the thread, behind all that has been told to it before.

    Args:
        queue: to the thread.
    """

    def __init__(self, queue: RecorderQueue) -> None:
        self._queue = queue
        self._loop = asyncio.get_running_loop()

    def do(self, job: Callable[[], object]) -> None:
        """Have something done."""
        self._queue.put(Item("job", 0, value=job))
        self._queue.wake()

    async def done(self, job: Callable[[], T]) -> T:
        """Have something done; gives what comes of it, or raises what it raises."""
        answer: asyncio.Future[T] = self._loop.create_future()

        def carry_out() -> None:
            try:
                result = job()
            except Exception as error:  # noqa: BLE001 - whoever asked is told
                self.on_loop(partial(_fail, answer, error))
            else:
                self.on_loop(lambda: _tell(answer, result))

        self.do(carry_out)
        return await answer

    def on_loop(self, act: Callable[[], object]) -> None:
        """Called by the thread: do this on the loop."""
        with contextlib.suppress(RuntimeError):  # the loop is closed: nobody listens
            self._loop.call_soon_threadsafe(act)


def _tell(answer: asyncio.Future[T], result: T) -> None:
    if not answer.done():
        answer.set_result(result)


def _fail(answer: asyncio.Future[T], error: Exception) -> None:
    if not answer.done():
        answer.set_exception(error)
