"""What waits to be published: bounded, by kind, each with its own way to overflow.

Points are never dropped: when their queue is full, `offer_point` says no and the
capture is refused. Live poses and health are only worth their latest. Scan blocks
and events are dropped newest first, and counted. Order of sending: status, replies,
points, events, scan blocks, live, health.
"""

import asyncio
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import dataclass

MAX_POINTS = 1000
MAX_REPLIES = 100
MAX_EVENTS = 200
MAX_SCAN_BLOCKS = 400


@dataclass(frozen=True, slots=True)
class Outgoing:
    """One message on its way to the broker.

    Attributes:
        sent: called once, after the broker has taken it.
        correlation: MQTT 5 correlation data of an answer.
    """

    topic: str
    payload: bytes
    qos: int = 0
    retain: bool = False
    correlation: bytes | None = None
    sent: Callable[[], None] | None = None


class OutgoingQueue:
    """The one queue between the event loop's work and the publisher.

    Attributes:
        dropped: messages dropped, by kind.
        sent: messages that the broker has taken, by kind.
    """

    def __init__(
        self, max_points: int = MAX_POINTS, max_scan_blocks: int = MAX_SCAN_BLOCKS
    ) -> None:
        self._limits = {
            "reply": MAX_REPLIES,
            "point": max_points,
            "event": MAX_EVENTS,
            "scan": max_scan_blocks,
        }
        # In the order of sending; a kind without a limit keeps its latest only.
        kinds = ("status", "reply", "point", "event", "scan", "live", "health")
        self._waiting: dict[str, deque[Outgoing]] = {kind: deque() for kind in kinds}
        self._filled = asyncio.Event()
        self._emptied = asyncio.Event()
        self.dropped: Counter[str] = Counter()
        self.sent: Counter[str] = Counter()

    @property
    def limit(self) -> int:
        """How many messages may wait, of all kinds that are not thinned."""
        return sum(self._limits.values())

    def waiting(self, kind: str) -> int:
        """How many messages of ``kind`` wait."""
        return len(self._waiting[kind])

    def offer(self, kind: str, message: Outgoing) -> bool:
        """Queue a message; False where there was no room and it was dropped."""
        queue = self._waiting[kind]
        limit = self._limits.get(kind)
        if limit is None:
            if queue and kind == "live":
                self.dropped[kind] += 1  # thinned: a newer pose replaces it
            queue.clear()
        elif len(queue) >= limit:
            self.dropped[kind] += kind != "point"  # a point is refused, not dropped
            return False
        queue.append(message)
        self._emptied.clear()
        self._filled.set()
        return True

    async def next(self) -> tuple[str, Outgoing]:
        """The message to send next; it stays queued until `done`."""
        while True:
            for kind, queue in self._waiting.items():
                if queue:
                    return kind, queue[0]
            self._emptied.set()
            self._filled.clear()
            await self._filled.wait()

    def done(self, kind: str, message: Outgoing) -> None:
        """``message`` has been sent: forget it."""
        queue = self._waiting[kind]
        if queue and queue[0] is message:
            queue.popleft()
        self.sent[kind] += 1
        if message.sent is not None:
            message.sent()

    def drop(self, kind: str, message: Outgoing) -> None:
        """``message`` cannot be sent: forget it and count that."""
        queue = self._waiting[kind]
        if queue and queue[0] is message:
            queue.popleft()
        self.dropped[kind] += 1

    async def empty(self) -> None:
        """Wait until everything has been sent."""
        await self._emptied.wait()
