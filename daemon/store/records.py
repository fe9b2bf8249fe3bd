"""Values that go between the event loop, the writer's thread and the database."""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from traverse.daemon.config.schema import OutboxSection
from traverse.protocol.encoding import Encoding
from traverse.protocol.messages import Point


@dataclass(frozen=True, slots=True)
class NewMessage:
    """A point that is to be kept: its message as it will be published.

    Attributes:
        begun_ns: when the session began [UTC].
        note: the user's note about the session.
        time_ns: of the point [UTC].
        encoding: of the payload.
    """

    session: str
    begun_ns: int
    note: str
    seq: int
    id: str
    time_ns: int
    topic: str
    encoding: Encoding
    payload: bytes


@dataclass(frozen=True, slots=True)
class StoredMessage:
    """A message that the database has.

    Attributes:
        number: grows by one with each message ever kept; the order of sending.
        is_sent: the broker has acknowledged it.
    """

    number: int
    session: str
    seq: int
    id: str
    time_ns: int
    topic: str
    encoding: Encoding
    payload: bytes
    is_sent: bool


def stored_message_of(entry: NewMessage, number: int) -> StoredMessage:
    """What has just been kept, under its number."""
    return StoredMessage(
        number,
        entry.session,
        entry.seq,
        entry.id,
        entry.time_ns,
        entry.topic,
        entry.encoding,
        entry.payload,
        is_sent=False,
    )


@dataclass(frozen=True, slots=True)
class StoredSession:
    """A session of which the database has points.

    Attributes:
        begun_ns: when it began [UTC].
        first_seq, last_seq: the numbers held.
    """

    session: str
    begun_ns: int
    note: str
    first_seq: int
    last_seq: int


@dataclass(frozen=True, slots=True)
class StoredRange:
    """What the database has of a session.

    Attributes:
        points: how many of the requested range.
        first_seq, last_seq: of the whole session; None where it has nothing of it.
    """

    points: int
    first_seq: int | None
    last_seq: int | None


@dataclass(frozen=True, slots=True)
class StoreStatistics:
    """How the database is.

    Attributes:
        points: messages in it.
        unsent: those that the broker does not have yet.
        size_bytes: of the file, without its log.
        used_bytes: of those, what messages take.
        oldest_unsent_ns: time of the oldest of those [UTC].
    """

    points: int = 0
    unsent: int = 0
    size_bytes: int = 0
    used_bytes: int = 0
    oldest_unsent_ns: int | None = None


@dataclass(frozen=True, slots=True)
class StorageError:
    """Why points cannot be kept, and what people can do."""

    text: str
    remedy: str


class StoreRefusedError(Exception):
    """The file must not be touched; the text states the reason and the remedy."""


@dataclass(frozen=True, slots=True)
class WriteJob:
    """Store a point; its callback gets the number, or None on failure.

    Attributes:
        generation: grows whenever points have failed.
    """

    generation: int
    entry: NewMessage


@dataclass(frozen=True, slots=True)
class QueryJob:
    """Do something with the database; the callback gets the result or exception."""

    work: Callable[[Any], Any]
    told: Callable[[Any], None]


@dataclass(frozen=True, slots=True)
class RetentionRules:
    """What may be deleted."""

    section: OutboxSection
    running: str


@dataclass(frozen=True, slots=True)
class StoreStatus:
    """How the outbox is, as its thread sees it."""

    trouble: StorageError | None = None
    figures: StoreStatistics = StoreStatistics()


Job = WriteJob | QueryJob | RetentionRules


class PendingWrite:
    """A point that has a number, and is not known to be on the disk yet.

    Attributes:
        point: a capture or a retraction.
        is_settled: it is on the disk, or it is not and never will be.
        trouble: why it is not.
        roll_back: called if the write fails, before anybody is notified of that.
    """

    def __init__(self, point: Point) -> None:
        self.point = point
        self.is_settled = False
        self.trouble: StorageError | None = None
        self.roll_back: Callable[[], object] = lambda: None
        self._acts: list[Callable[[], object]] = []

    def settle(self, trouble: StorageError | None = None) -> None:
        """It is on the disk now; with a trouble, it never will be."""
        self.trouble = trouble
        self.is_settled = True
        for act in self._acts:
            act()

    def on_settled(self, act: Callable[[], object]) -> None:
        """Have something called as soon as it is; at once if it is already."""
        if self.is_settled:
            act()
        else:
            self._acts.append(act)


class PendingWrites:
    """Writes in the order of their points' numbers."""

    def __init__(self) -> None:
        self._writes: deque[PendingWrite] = deque()

    def __len__(self) -> int:
        return len(self._writes)

    def add(self, point: Point) -> PendingWrite:
        """Add a point that is being written."""
        write = PendingWrite(point)
        self._writes.append(write)
        return write

    def keep(self) -> Point:
        """Settle the first, which is on the disk; return its point."""
        write = self._writes.popleft()
        write.settle()
        return write.point

    def fail(self, trouble: StorageError) -> None:
        """Fail all: roll back from the newest to the oldest, only then notify."""
        failed = list(self._writes)
        self._writes.clear()
        for write in reversed(failed):
            write.roll_back()
        for write in failed:
            write.settle(trouble)
