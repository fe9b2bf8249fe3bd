"""Values that go between the event loop, the writer's thread and the database."""

import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from traverse.protocol.encoding import Encoding
from traverse.protocol.messages import Point


@dataclass(frozen=True, slots=True)
class StorableMessage:
    """A point, or a block of a scan, as it is published.

    Attributes:
        session: of the point; of a block, the scan.
        seq: number in it; of a block, that of its first point.
        time_ns: of the point [UTC].
    """

    session: str
    seq: int
    id: str
    time_ns: int
    topic: str
    encoding: Encoding
    payload: bytes

    @property
    def checksum(self) -> int:
        """CRC-32 over all of it; stored beside it, so that damage is noticed."""
        row = (
            f"{self.session}\n{self.seq}\n{self.id}\n{self.time_ns}\n{self.topic}\n"
            f"{self.encoding}\n"
        )
        return zlib.crc32(self.payload, zlib.crc32(row.encode()))


@dataclass(frozen=True, slots=True)
class NewMessage(StorableMessage):
    """A message that is to be stored.

    Attributes:
        begun_ns: when the session began [UTC].
        note: the user's note about the session; of a scan, the session.
        request: of the command that took the point; None for all others.
    """

    begun_ns: int
    note: str
    request: str | None = None


@dataclass(frozen=True, slots=True)
class StoredMessage(StorableMessage):
    """A message that the database has.

    Attributes:
        number: grows by one with each message ever stored; the order of sending.
        is_sent: the broker has acknowledged it.
        is_whole: it is as it was stored; else nothing of it can be relied on, not even
            the types.
        request: of the command that took the point, where that was asked for.
    """

    number: int
    is_sent: bool
    is_whole: bool = True
    request: str | None = None


@dataclass(frozen=True, slots=True)
class StoredSession:
    """A session of which the database has points.

    Attributes:
        begun_ns: when it began [UTC].
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
class RetentionRules:
    """What the broker has is deleted when it is older, or the file is larger."""

    keep_days: float
    keep_mb: float


class DatabaseRefusedError(Exception):
    """The file must not be touched; the text states the reason and the remedy."""


class StateFolderError(DatabaseRefusedError):
    """The folder is in use, or cannot be used now; a later start may succeed."""


# -- what the thread reports --------------------------------------------------


@dataclass(frozen=True, slots=True)
class StorageError:
    """Why messages cannot be stored, and what people can do."""

    text: str
    remedy: str


@dataclass(frozen=True, slots=True)
class Committed:
    """The oldest messages on their way are safe now, under these numbers."""

    numbers: Sequence[int]


@dataclass(frozen=True, slots=True)
class WriteFailed:
    """Nothing that is on its way will be stored, until the writer is resumed."""

    trouble: StorageError


@dataclass(frozen=True, slots=True)
class Replaced:
    """A new database has been begun; why, in words."""

    text: str


@dataclass(frozen=True, slots=True)
class SetAside:
    """Messages are damaged, and are not sent; which, in words."""

    text: str
    count: int


@dataclass(frozen=True, slots=True)
class Removed:
    """Delivered messages were removed; why, in words."""

    count: int
    why: str


@dataclass(frozen=True, slots=True)
class StoreStatus:
    """How the store is, as its thread sees it; reported whenever it changes."""

    trouble: StorageError | None = None
    statistics: StoreStatistics = StoreStatistics()


Notification = Committed | WriteFailed | Replaced | SetAside | Removed | StoreStatus


# -- what waits for the thread ------------------------------------------------


class PendingWrite:
    """A message that is not known to be on the disk yet.

    Attributes:
        is_settled: it is on the disk, or it is not and never will be.
        trouble: why it is not.
    """

    def __init__(self) -> None:
        self.is_settled = False
        self.trouble: StorageError | None = None
        self._undo: list[Callable[[], object]] = []
        self._acts: list[Callable[[], object]] = []

    def settle(self, trouble: StorageError | None = None) -> None:
        """It is on the disk now; with a trouble, it never will be."""
        self.trouble = trouble
        self.is_settled = True
        acts, self._acts = self._acts, []
        self._undo.clear()  # what is called refers to this: a cycle, for the collector
        for act in acts:
            act()

    def roll_back(self) -> None:
        """Take back what depends on it, before anybody is notified that it failed."""
        for act in self._undo:
            act()

    def on_roll_back(self, act: Callable[[], object]) -> None:
        """Have something called if the write fails."""
        self._undo.append(act)

    def on_settled(self, act: Callable[[], object]) -> None:
        """Have something called as soon as it is; at once if it is already."""
        if self.is_settled:
            act()
        else:
            self._acts.append(act)


class PendingPoint(PendingWrite):
    """A point that has a number, and is not known to be on the disk yet."""

    def __init__(self, point: Point) -> None:
        super().__init__()
        self.point = point


def fail_all(writes: Sequence[PendingWrite], trouble: StorageError) -> None:
    """Roll back from the newest to the oldest, only then notify."""
    for write in reversed(writes):
        write.roll_back()
    for write in writes:
        write.settle(trouble)
