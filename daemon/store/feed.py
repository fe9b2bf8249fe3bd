"""From the disk to the broker: some points at a time, however many there are.

A new point goes to the outgoing queue from memory as long as all before it are there.
Else it stays on the disk, and is read when those before it have gone: memory holds a
few hundred points, whatever the broker does.

What the broker refuses, by an access list say, is tried again after some minutes, and
all that came after it only then: a broker that takes nothing is not kept busy.
"""

from collections.abc import Callable, Sequence

from traverse.daemon.clock import HostClock
from traverse.daemon.monitoring.latencies import Latencies
from traverse.daemon.mqtt.outgoing_queue import OutgoingMessage, OutgoingQueue
from traverse.daemon.store.database import MessageDatabase
from traverse.daemon.store.queries import read_unsent
from traverse.daemon.store.records import Held
from traverse.protocol.topics import CHANNELS

TOGETHER = 100
REFUSED_NS = 120_000_000_000

Told = Callable[[object], None]
Work = Callable[[MessageDatabase], object]


def outgoing(
    message: Held,
    sent: Callable[[], None] | None = None,
    refused: Callable[[], None] | None = None,
) -> OutgoingMessage:
    """A message of the database as it is handed to the broker."""
    return OutgoingMessage(
        message.topic,
        message.payload,
        qos=CHANNELS["point"].qos,
        sent=sent,
        refused=refused,
        encoding=message.encoding,
    )


class UnsentFeeder:
    """Puts all messages into the queue that the broker does not have, in order.

    Args:
        queue: of what is to be published.
        ask: has something done with the database.
        mark: called with the number of each that the broker has.
        clock: the host's.
        latency: told how long the broker took for each.
        kind: under which they wait in the queue.
        together: so many are read at once, when no more than that wait.

    Attributes:
        has_backlog: messages wait on the disk, or may.
    """

    def __init__(
        self,
        queue: OutgoingQueue,
        ask: Callable[[Work, Told], None],
        mark: Callable[[int], None],
        clock: HostClock,
        latency: Latencies,
        *,
        kind: str = "point",
        together: int = TOGETHER,
    ) -> None:
        self._queue = queue
        self._ask = ask
        self._mark = mark
        self._clock = clock
        self._latency = latency
        self._kind = kind
        self._together = together
        self._last_number = 0  # of those that are, or were, in the queue
        self.has_backlog = True  # at the start: an earlier run may have left some
        self._is_reading = False
        self._refused: int | None = None  # the first of them
        self._resumes_ns = 0

    def kept(self, message: Held) -> None:
        """A new message is on the disk."""
        if not self.has_backlog:
            self.has_backlog = not self._offer(message)

    def look_again(self) -> None:
        """The database may hold messages that nobody has told of."""
        self.has_backlog = True
        self.refill()

    def refill(self) -> None:
        """Read on, where messages wait on the disk and there is room for them."""
        if (
            not self.has_backlog
            or self._is_reading
            or self._queue.waiting(self._kind) > self._together
            or not self._may_resume()
        ):
            return
        self._is_reading = True
        after = self._last_number
        self._ask(
            lambda store: read_unsent(store.connection, after, self._together),
            self._read,
        )

    def _may_resume(self) -> bool:
        """Nothing was refused, or that is long ago: then it is read once more."""
        if self._refused is None:
            return True
        is_due = self._clock.monotonic_ns() >= self._resumes_ns
        if not is_due or self._queue.waiting(self._kind):
            return False
        self._last_number, self._refused = self._refused - 1, None
        return True

    def _read(self, found: object) -> None:
        self._is_reading = False
        if self._refused is not None:
            return  # meanwhile; it is read again when that is tried again
        if not isinstance(found, Sequence):
            return  # it cannot be read now; somebody calls `refill` again
        # What was kept after this was read is told after it: nothing is missed.
        self.has_backlog = len(found) == self._together
        for message in found:
            if not self._offer(message):
                self.has_backlog = True
                return

    def _offer(self, message: Held) -> bool:
        number, begun_ns = message.number, self._clock.monotonic_ns()

        def sent() -> None:
            self._latency.add(self._clock.monotonic_ns() - begun_ns)
            self._mark(number)

        def refused() -> None:
            self.has_backlog = True
            first = number if self._refused is None else self._refused
            self._refused = min(first, number)
            self._resumes_ns = self._clock.monotonic_ns() + REFUSED_NS

        there = self._queue.offer(self._kind, outgoing(message, sent, refused))
        if there:
            self._last_number = number
        return there
