"""Bounded queue of messages to publish, with a rule of overflow for each kind.

Points and spooled blocks of scans are never dropped: those without room here are on the
disk, and are queued later. Of live poses and health the latest is kept. Scan blocks and
events are dropped newest first, and counted. Order of sending: clock, status, replies,
points, events, requested again, spooled scan blocks, scan blocks, live, health.
"""

import asyncio
import contextlib
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from traverse.protocol.encoding import Encoding

MAX_POINTS = 1000
MAX_REPLIES = 100
MAX_EVENTS = 200
MAX_RESENT = 200
MAX_SPOOLED = 100
MAX_SCAN_BLOCKS = 400
# In the order of sending; of a kind without a limit only the latest is kept.
LIMITS: Mapping[str, int | None] = {
    "clock": None,
    "status": None,
    "reply": MAX_REPLIES,
    "point": MAX_POINTS,
    "event": MAX_EVENTS,
    "resend": MAX_RESENT,
    "spooled": MAX_SPOOLED,
    "scan": MAX_SCAN_BLOCKS,
    "live": None,
    "health": None,
}
ON_DISK = frozenset({"point", "spooled"})  # what finds no room is there


@dataclass(frozen=True, slots=True)
class OutgoingMessage:
    """One message on its way to the broker.

    Attributes:
        sent: called once, after the broker has taken it.
        refused: called instead where the broker refuses it; its owner tries again
            later.
        encoding: encoding of the payload, if not the configured one.
        correlation: MQTT 5 correlation data of an answer.
        expiry_s: for how long the broker keeps it for absent subscribers; None: no
            limit.
    """

    topic: str
    payload: bytes
    qos: int = 0
    retain: bool = False
    correlation: bytes | None = None
    sent: Callable[[], None] | None = None
    refused: Callable[[], None] | None = None
    encoding: Encoding | None = None
    expiry_s: int | None = None


class OutgoingQueue:
    """Queue between the event loop's work and the publisher.

    A sent message stays here, on its way, until the broker has it.

    Attributes:
        dropped: messages dropped, by kind.
        sent: messages that the broker has taken, by kind.
        too_long: messages that were longer than the broker takes, by kind.
    """

    def __init__(
        self, max_points: int = MAX_POINTS, max_scan_blocks: int = MAX_SCAN_BLOCKS
    ) -> None:
        self._limits = {**LIMITS, "point": max_points, "scan": max_scan_blocks}
        self._waiting: dict[str, deque[OutgoingMessage]] = {k: deque() for k in LIMITS}
        self._on_the_way: dict[str, deque[OutgoingMessage]] = {
            k: deque() for k in LIMITS
        }
        self._emptied = asyncio.Event()
        self.dropped: Counter[str] = Counter()
        self.sent: Counter[str] = Counter()
        self.too_long: Counter[str] = Counter()
        self._on_offered: Callable[[], None] | None = None

    @property
    def limit(self) -> int:
        """Most messages that may wait, of all kinds that are not thinned."""
        return sum(limit or 0 for limit in self._limits.values())

    def waiting(self, kind: str) -> int:
        """Number of messages of ``kind`` that the broker does not have yet."""
        return len(self._waiting[kind]) + len(self._on_the_way[kind])

    def offer(
        self, kind: str, message: OutgoingMessage, *, at_once: bool = True
    ) -> bool:
        """Queue a message; return False if there was no room and it was dropped.

        Unless it is to be sent ``at_once`` it is sent with the next that is, or at
        `flush`: each packet by itself costs a write, and a wake-up for its answer.
        """
        queue = self._waiting[kind]
        limit = self._limits[kind]
        if limit is None:
            if queue and kind == "live":
                self.dropped[kind] += 1  # thinned: a newer pose replaces it
            queue.clear()
        elif self.waiting(kind) >= limit:
            self.dropped[kind] += kind not in ON_DISK
            return False
        queue.append(message)
        self._emptied.clear()
        if at_once:
            self.flush()
        return True

    def flush(self) -> None:
        """Have all waiting messages sent."""
        if self._on_offered is not None:
            self._on_offered()

    @contextlib.contextmanager
    def notifying(self, on_offered: Callable[[], None]) -> Iterator[None]:
        """Within the block, call a function after each message that is queued."""
        self._on_offered = on_offered
        try:
            yield
        finally:
            self._on_offered = None

    def next(self, without: str = "") -> tuple[str, OutgoingMessage] | None:
        """Take the next message to send, but of one kind; now it is on its way."""
        for kind, queue in self._waiting.items():
            if queue and kind != without:
                message = queue.popleft()
                self._on_the_way[kind].append(message)
                return kind, message
        return None

    def take_back(self, kinds: Iterable[str] = LIMITS) -> None:
        """Queue the messages on their way again, in order."""
        for kind in kinds:
            gone = self._on_the_way[kind]
            if self._limits[kind] is not None or not self._waiting[kind]:
                self._waiting[kind].extendleft(reversed(gone))
            gone.clear()

    def done(self, kind: str, message: OutgoingMessage) -> None:
        """Drop a message that has been sent."""
        self._forget(kind, message)
        self.sent[kind] += 1
        if message.sent is not None:
            message.sent()

    def drop(self, kind: str, message: OutgoingMessage) -> None:
        """Drop and count a message that cannot be sent."""
        self._forget(kind, message)
        self.dropped[kind] += 1

    def replace(
        self, kind: str, message: OutgoingMessage, parts: Sequence[OutgoingMessage]
    ) -> None:
        """Send ``parts`` before all others of their kind, instead of ``message``."""
        self._forget(kind, message)
        self._waiting[kind].extendleft(reversed(parts))

    def set_aside(self, kind: str, message: OutgoingMessage) -> None:
        """Set a message aside that is too long for the broker, and count it.

        A stored one remains stored, and can be requested again.
        """
        self._forget(kind, message)
        self.too_long[kind] += 1
        if message.sent is not None:
            message.sent()

    def defer(self, kind: str, message: OutgoingMessage) -> None:
        """Drop a message that its owner will queue again later."""
        self._forget(kind, message)
        if message.refused is not None:
            message.refused()

    async def empty(self) -> None:
        """Wait until everything has been sent."""
        while any(self.waiting(kind) for kind in self._waiting):
            self._emptied.clear()
            await self._emptied.wait()

    def _forget(self, kind: str, message: OutgoingMessage) -> None:
        gone = self._on_the_way[kind]
        if gone and gone[0] is message:  # answers arrive in the order of sending
            gone.popleft()
        else:
            self._on_the_way[kind] = deque(
                waiting for waiting in gone if waiting is not message
            )
        self._emptied.set()
