"""Answers to commands, stored for repeated requests: bounded in number and bytes."""

import asyncio
from collections import OrderedDict
from collections.abc import Coroutine
from typing import Any

MAX_REMEMBERED = 256
MAX_REMEMBERED_BYTES = 4_194_304


class Answers:
    """The first answer to each request, by the command's name and the request.

    A pending answer is never dropped.
    """

    def __init__(self) -> None:
        self._answers: OrderedDict[tuple[str, str], asyncio.Task[bytes]] = OrderedDict()
        self._working: set[asyncio.Task[bytes]] = set()
        self._bytes = 0

    @property
    def n_executing(self) -> int:
        """How many are being worked on."""
        return len(self._working)

    def find(self, name: str, request: str) -> asyncio.Task[bytes] | None:
        """The first answer to a request, finished or not, if it is remembered."""
        return self._answers.get((name, request))

    def begin(
        self, name: str, request: str, work: Coroutine[Any, Any, bytes]
    ) -> asyncio.Task[bytes]:
        """Work on an answer and remember it."""
        task = asyncio.create_task(work)
        self._working.add(task)
        self._answers[name, request] = task
        task.add_done_callback(self._ended)
        return task

    async def close(self) -> None:
        """Abandon what is being worked on."""
        tasks = tuple(self._working)
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    def _ended(self, task: asyncio.Task[bytes]) -> None:
        self._working.discard(task)
        self._bytes += _size(task)
        while len(self._answers) > MAX_REMEMBERED or self._bytes > MAX_REMEMBERED_BYTES:
            done = (key for key, one in self._answers.items() if one.done())
            oldest = next(done, None)
            if oldest is None:
                return
            self._bytes -= _size(self._answers.pop(oldest))


def _size(task: asyncio.Task[bytes]) -> int:
    return 0 if task.cancelled() else len(task.result())
