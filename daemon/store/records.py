"""What goes between the event loop, the outbox's thread and its database."""

from dataclasses import dataclass

from traverse.protocol.encoding import Encoding


@dataclass(frozen=True, slots=True)
class Entry:
    """A point that is to be kept: its message as it will be published.

    Attributes:
        begun_ns: when the session began [UTC].
        note: what people said about the session.
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
class Held:
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


def stored_message_of(entry: Entry, number: int) -> Held:
    """What has just been kept, under its number."""
    return Held(
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
class HeldSession:
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
        points: how many of the range that was asked about.
        first_seq, last_seq: of the whole session; None where it has nothing of it.
    """

    points: int
    first_seq: int | None
    last_seq: int | None


@dataclass(frozen=True, slots=True)
class Figures:
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
    """The file is one that must be left alone; the text says why and what to do."""
