"""The outbox: a point is on the disk before it is acknowledged."""

import contextlib
import fcntl
import os
from collections.abc import AsyncIterator, Callable, Iterator, Mapping
from functools import partial
from pathlib import Path

from traverse.daemon.config.schema import OutboxSection
from traverse.daemon.current_request import CURRENT_REQUEST
from traverse.daemon.monitoring.events import EventLog
from traverse.daemon.monitoring.latencies import Latencies
from traverse.daemon.mqtt.message_publisher import MessagePublisher
from traverse.daemon.state_dir import OWNER_ONLY, unusable
from traverse.daemon.store.durable_queue import DurableQueue, QueueProfile
from traverse.daemon.store.point_signer import PointSigner
from traverse.daemon.store.queries import read_requested
from traverse.daemon.store.records import (
    NewMessage,
    PendingPoint,
    RetentionRules,
    StateFolderError,
)
from traverse.protocol.encoding import Encoding, decode, encode
from traverse.protocol.messages import OutboxHealth, Point
from traverse.protocol.topics import point_topic

ANSWERED_NS = 600 * 10**9
PROFILE = QueueProfile(
    thread="outbox",
    kind="point",
    source="outbox",
    failed="outbox.failed",
    failed_text="{}",
    restored_text="points are kept again",
    replaced="outbox.replaced",
    damaged="outbox.damaged",
    removed="outbox.removed",
    replaced_remedy="check the disk; points that only an old file has can be taken out "
    "of it with `traverse points export --db`, as far as it can be read",
)


def message_of(
    point: Point, topic: str, encoding: Encoding, begun_ns: int, note: str
) -> NewMessage:
    """Convert a point for storage; the last two arguments are of its session."""
    return NewMessage(
        point.session,
        point.seq,
        point.id,
        point.time_ns,
        topic,
        encoding,
        encode(point, encoding),
        begun_ns,
        note,
        CURRENT_REQUEST.get(),
    )


class Outbox(DurableQueue):
    """Stores an arm's points and has them sent.

    Args:
        limit: most points on their way to the disk.
        latencies: receives latencies to the disk, and from there to the broker.
        ready_changed: called when storing becomes possible or impossible.
        signer: signs points; None: they are not signed.
    """

    def __init__(
        self,
        path: Path,
        publisher: MessagePublisher,
        events: EventLog,
        *,
        section: OutboxSection,
        limit: int,
        latencies: Mapping[str, Latencies],
        ready_changed: Callable[[], None] = lambda: None,
        signer: PointSigner | None = None,
    ) -> None:
        super().__init__(
            path,
            PROFILE,
            publisher,
            events,
            retention=RetentionRules(section.keep_days, section.keep_mb),
            to_disk=latencies["point_to_disk"],
            to_broker=latencies["publish_to_ack"],
            ready_changed=ready_changed,
        )
        self._topic = point_topic(publisher.arm)
        self._limit = limit
        self.signer = signer

    @contextlib.asynccontextmanager
    async def running(self, *, is_needed: bool = True) -> AsyncIterator[None]:
        """Run, and exclude other daemons from the folder.

        Raises:
            DatabaseRefusedError: the database, or the folder, must be left alone.
        """
        with exclusive_state_dir(self.path.parent):
            async with super().running(is_needed=is_needed):
                yield

    def use(self, section: OutboxSection) -> None:
        self._writer.retention = RetentionRules(section.keep_days, section.keep_mb)

    def put_point(self, point: Point, begun_ns: int, note: str) -> PendingPoint | None:
        """Write a point or retraction to the disk; None if too many are on their way.

        ``begun_ns`` [UTC] and ``note`` are of its session.
        """
        if not self.is_open or self.n_in_flight >= self._limit:
            return None
        write = PendingPoint(point)
        if self.signer is not None:
            point = self.signer.signed(point)
            write.on_roll_back(partial(self.signer.roll_back, point))
        self.put(message_of(point, self._topic, self._encoding, begun_ns, note), write)
        return write

    async def answered(self, at_most: int) -> list[tuple[str, Point]]:
        """Return the latest requests that took or retracted a point, oldest first.

        Requests older than `ANSWERED_NS` are left out: people reuse them.

        Raises:
            RequestRefusedError: the database cannot be read.
        """
        now_ns = self._clock.to_utc_ns(self._clock.monotonic_ns())
        messages = await self.query(
            lambda store: store.read(read_requested, now_ns - ANSWERED_NS, at_most)
        )
        return [
            (message.request, decode(Point, message.payload, message.encoding))
            for message in messages
            if message.request is not None
        ]

    def health(self) -> OutboxHealth:
        statistics = self.status.statistics
        return OutboxHealth(
            state="ready" if self.is_ready else "failed",
            points=statistics.points,
            unsent=statistics.unsent,
            bytes=statistics.size_bytes,
            oldest_unsent_ns=statistics.oldest_unsent_ns,
        )


@contextlib.contextmanager
def exclusive_state_dir(folder: Path) -> Iterator[None]:
    """Hold a state folder for one daemon.

    The lock is the system's, on the folder itself: it ends with the process and needs
    no file.

    Raises:
        StateFolderError: another daemon holds it, or locking failed.
    """
    with contextlib.ExitStack() as stack:
        try:
            folder.mkdir(mode=OWNER_ONLY, parents=True, exist_ok=True)
            descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
            stack.callback(os.close, descriptor)
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise StateFolderError(
                f"{folder}: another daemon uses this state folder; end it, or give "
                "this one a configuration in another folder"
            ) from error
        except OSError as error:
            raise StateFolderError(f"{folder}: {unusable(error)}") from error
        yield
