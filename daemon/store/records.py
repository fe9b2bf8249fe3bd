"""Values exchanged by event loop, writer thread and database."""

import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from traverse.protocol.encoding import Encoding
from traverse.protocol.messages import Point


@dataclass(frozen=True, slots=True)
class StorableMessage:
    """A point or scan block as it is published.

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
        """CRC-32 over all fields, stored to detect damage."""
        row = (
            f"{self.session}\n{self.seq}\n{self.id}\n{self.time_ns}\n{self.topic}\n"
            f"{self.encoding}\n"
        )
        return zlib.crc32(self.payload, zlib.crc32(row.encode()))


@dataclass(frozen=True, slots=True)
class NewMessage(StorableMessage):
    """A message to be stored.

    Attributes:
        begun_ns: begin of the session [UTC].
        note: the user's note about the session; of a scan, the session.
        request: of the command that took the point; else None.
    """

    begun_ns: int
    note: str
    request: str | None = None


@dataclass(frozen=True, slots=True)
class StoredMessage(StorableMessage):
    """A message in the database.

    Attributes:
        number: increases with each message stored; the order of sending.
        is_sent: the broker has acknowledged it.
        is_whole: undamaged; otherwise no field is reliable, not even its type.
        request: of the command that took the point, if the query reads it.
    """

    number: int
    is_sent: bool
    is_whole: bool = True
    request: str | None = None


@dataclass(frozen=True, slots=True)
class StoredSession:
    """A session in the database.

    Attributes:
        begun_ns: its beginning [UTC].
    """

    session: str
    begun_ns: int
    note: str
    first_seq: int
    last_seq: int


@dataclass(frozen=True, slots=True)
class StoredRange:
    """Figures of a session.

    Attributes:
        points: in the requested range.
        first_seq, last_seq: of the whole session; None if it has no points.
    """

    points: int
    first_seq: int | None
    last_seq: int | None


@dataclass(frozen=True, slots=True)
class StoreStatistics:
    """Figures of the database.

    Attributes:
        unsent: messages that the broker lacks.
        size_bytes: of the file, without its log.
        oldest_unsent_ns: time of the oldest unsent one [UTC].
    """

    points: int = 0
    unsent: int = 0
    size_bytes: int = 0
    used_bytes: int = 0
    oldest_unsent_ns: int | None = None


@dataclass(frozen=True, slots=True)
class RetentionRules:
    """Age and file size beyond which sent messages are deleted."""

    keep_days: float
    keep_mb: float


class DatabaseRefusedError(Exception):
    """The file must not be touched; states the reason and the remedy."""


class StateFolderError(DatabaseRefusedError):
    """The folder is in use or unusable; a later start may succeed."""


# -- what the thread reports --------------------------------------------------


@dataclass(frozen=True, slots=True)
class StorageError:
    """Why messages cannot be stored, and what people can do."""

    text: str
    remedy: str


@dataclass(frozen=True, slots=True)
class Committed:
    """The oldest messages on their way are stored under these numbers."""

    numbers: Sequence[int]


@dataclass(frozen=True, slots=True)
class WriteFailed:
    """No message on its way will be stored, until the writer is resumed."""

    trouble: StorageError


@dataclass(frozen=True, slots=True)
class Replaced:
    """A new database was begun; why, in words."""

    text: str


@dataclass(frozen=True, slots=True)
class SetAside:
    """Damaged messages are not sent; which, in words."""

    text: str
    count: int


@dataclass(frozen=True, slots=True)
class Removed:
    """Sent messages were removed; why, in words."""

    count: int
    why: str


@dataclass(frozen=True, slots=True)
class StoreStatus:
    """State of the store as its thread sees it; reported on changes."""

    trouble: StorageError | None = None
    statistics: StoreStatistics = StoreStatistics()


Notification = Committed | WriteFailed | Replaced | SetAside | Removed | StoreStatus


# -- what waits for the thread ------------------------------------------------


class PendingWrite:
    """A message on its way to the disk.

    Attributes:
        is_settled: it is stored, or has failed.
    """

    def __init__(self) -> None:
        self.is_settled = False
        self.trouble: StorageError | None = None
        self._undo: list[Callable[[], object]] = []
        self._acts: list[Callable[[], object]] = []

    def settle(self, trouble: StorageError | None = None) -> None:
        """Mark the write as done, or as failed with a trouble."""
        self.trouble = trouble
        self.is_settled = True
        acts, self._acts = self._acts, []
        self._undo.clear()  # what is called refers to this: a cycle, for the collector
        for act in acts:
            act()

    def roll_back(self) -> None:
        """Undo what depends on it, before anybody learns of the failure."""
        for act in self._undo:
            act()

    def on_roll_back(self, act: Callable[[], object]) -> None:
        """Register a call for the case that the write fails."""
        self._undo.append(act)

    def on_settled(self, act: Callable[[], object]) -> None:
        """Register a call for when it is settled; called at once if it is."""
        if self.is_settled:
            act()
        else:
            self._acts.append(act)


class PendingPoint(PendingWrite):
    """A numbered point on its way to the disk."""

    def __init__(self, point: Point) -> None:
        super().__init__()
        self.point = point


def fail_all(writes: Sequence[PendingWrite], trouble: StorageError) -> None:
    """Roll back from the newest to the oldest, then notify."""
    for write in reversed(writes):
        write.roll_back()
    for write in writes:
        write.settle(trouble)
