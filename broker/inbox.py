"""Messages that a client has received, and nobody has used yet."""

import asyncio
import logging
from collections.abc import AsyncIterator
from typing import Any

from traverse.broker.errors import MqttError
from traverse.broker.packets import Message

log = logging.getLogger(__name__)

MAX_QUEUED = 10_000


class Inbox:
    """Keep messages of a connection in order; those that find no room are dropped.

    Args:
        closed: done when the connection has ended, with the reason.

    Attributes:
        n_dropped: messages that there was no room for.
    """

    def __init__(self, closed: asyncio.Future[MqttError]) -> None:
        self._closed = closed
        self._queue: asyncio.Queue[Message] = asyncio.Queue(MAX_QUEUED)
        self.n_dropped = 0

    def put(self, message: Message) -> None:
        try:
            self._queue.put_nowait(message)
        except asyncio.QueueFull:
            if not self.n_dropped:
                log.warning(
                    "messages arrive faster than they are used; more than %d that wait "
                    "are dropped",
                    MAX_QUEUED,
                )
            self.n_dropped += 1

    async def messages(self) -> AsyncIterator[Message]:
        """Yield messages as they arrive.

        Raises:
            MqttError: the connection has ended; all messages before have been given.
        """
        while True:
            if self._queue.empty():
                waiting = asyncio.ensure_future(self._queue.get())
                try:
                    await first_of(waiting, self._closed)
                    if not waiting.done():
                        raise self._closed.result()
                    message = waiting.result()
                finally:
                    waiting.cancel()
            else:
                message = self._queue.get_nowait()
            yield message


async def first_of(*futures: asyncio.Future[Any]) -> None:
    await asyncio.wait(futures, return_when=asyncio.FIRST_COMPLETED)
