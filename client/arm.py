"""Programming interface to one arm: `async with Arm("bench-7") as arm`."""

import asyncio
import logging
from collections.abc import Callable, Coroutine, Mapping
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any, Literal, Self, Unpack

from traverse.broker.address import BrokerAddress
from traverse.client.cancel_tasks import cancel_tasks
from traverse.client.commands import ArmCommands, ScanOptions
from traverse.client.daemon_pulse import SILENT, DaemonPulse, as_offline
from traverse.client.errors import Counters
from traverse.client.feeds import Feed, Feeds, ScanBlocks
from traverse.client.mqtt.connection import IncomingMessage, ReconnectingConnection
from traverse.client.points.cursor import held_cursor, read_cursor, write_cursor
from traverse.client.points.doubts import KnownDoubts
from traverse.client.points.reorder_buffer import ReorderBuffer
from traverse.client.points.stream import PointIterator, PointStream
from traverse.client.requests import CommandClient
from traverse.protocol import topics
from traverse.protocol.encoding import decode
from traverse.protocol.message_error import MessageError
from traverse.protocol.messages import (
    Clock,
    Event,
    Health,
    Live,
    Point,
    Reply,
    Scan,
    Status,
)
from traverse.protocol.messages.later_doubt import LaterDoubt
from traverse.protocol.messages.scan import ScanMode

log = logging.getLogger(__name__)

MAX_EVENTS = 1000
MAX_BLOCKS = 1000
CURSOR_PERIOD_S = 0.5
BEGIN_S = 2.0


class Arm(ArmCommands):
    """An arm behind a broker; use with `async with`.

    Args:
        broker: "host", "host:port", "mqtts://host:port", or a BrokerAddress.
        since: first points: "now"; "session", all of the arm's present session;
            "beginning", all in the arm's outbox; or next numbers by session as returned
            by `cursor`, the newest session last.
        cursor_file: stores the consumer's cursor; an existing file overrides
            ``since``.
        connect_timeout_s: for the first connection.
        reply_timeout_s: for the answer to a command.
        max_waiting: most points waiting for their reader.
    """

    def __init__(
        self,
        name: str,
        broker: str | BrokerAddress = "localhost",
        *,
        since: Literal["now", "session", "beginning"] | Mapping[str, int] = "now",
        cursor_file: Path | str | None = None,
        connect_timeout_s: float = 10.0,
        reply_timeout_s: float = 10.0,
        max_waiting: int = 1000,
    ) -> None:
        self.name = name
        self._cursor_file = None if cursor_file is None else Path(cursor_file)
        self._connect_timeout_s = connect_timeout_s
        cursor: Mapping[str, int] | None = None
        if self._cursor_file is not None:
            cursor = read_cursor(self._cursor_file, name)
        is_whole = cursor is None and since == "session"
        if cursor is None and since not in ("now", "session"):
            cursor = {} if isinstance(since, str) else since
        address = BrokerAddress.parse(broker) if isinstance(broker, str) else broker
        self._link = ReconnectingConnection(address)
        super().__init__(CommandClient(name, self._link), reply_timeout_s)
        self._order = ReorderBuffer(cursor, is_whole=is_whole)
        self._doubts = KnownDoubts()
        self._stream = PointStream(
            self._order, self._link, self._requests, self._doubts, max(2, max_waiting)
        )
        # Answers arrive with quality of service 0: they must not wait behind points
        # that are held back, and a command without an answer is sent again.
        self._link.topics |= {
            topics.clock_topic(name): 0,
            topics.status_topic(name): 0,
            topics.health_topic(name): 0,
            topics.reply_filter(name): 0,
            topics.event_topic(name): 1,
            topics.point_topic(name): 1,
        }
        self._statuses = Feeds[Status](partial(Feed[Status], 1, keep_newest=True))
        self._healths = Feeds[Health](partial(Feed[Health], 1, keep_newest=True))
        self._events = Feeds[Event](partial(Feed[Event], MAX_EVENTS, keep_newest=True))
        self._clocks = Feeds[Clock](partial(Feed[Clock], 1, keep_newest=True))
        self._lives = Feeds[Live](partial(Feed[Live], 1, keep_newest=True))
        flagged_scan = self._doubts.flagged_scan
        self._scans = Feeds[Scan](
            partial(Feed[Scan], MAX_BLOCKS, keep_newest=False, prepare=flagged_scan)
        )
        self._kinds: dict[str, Callable[[IncomingMessage], None]] = {
            "clock": self._take_clock,
            "status": self._take_status,
            "health": lambda m: self._healths.put(decode(Health, m.payload)),
            "event": self._take_event,
            "live": lambda m: self._lives.put(decode(Live, m.payload)),
            "scan": lambda m: self._scans.put(decode(Scan, m.payload)),
            "reply": lambda m: self._requests.take_reply(decode(Reply, m.payload)),
            "point": self._take_point,
        }
        self._pulse = DaemonPulse()
        self._undecodable = 0
        self._tasks: set[asyncio.Task[None]] = set()
        self._held = ExitStack()

    async def __aenter__(self) -> Self:
        """Connect.

        Raises:
            BrokerUnreachableError: there is no connection in time.
            OSError: another program uses the cursor's file.
        """
        if self._cursor_file is not None:
            self._held.enter_context(held_cursor(self._cursor_file))
        self._run(self._link.run(self._take, self._link_changed))
        self._run(self._stream.follow())
        self._run(self._pulse.run())
        try:
            await self._link.wait_first(self._connect_timeout_s)
        except BaseException:
            with self._held:
                await self._end()
            raise
        if self._cursor_file is not None:
            self._run(self._save_cursor_periodically(self._cursor_file))
        try:
            async with asyncio.timeout(BEGIN_S):
                status = await self._statuses.first(BEGIN_S)
                if status.online:
                    await self._stream.begun()
        except TimeoutError:
            pass  # the arm is not there now; it is followed when it is
        return self

    async def __aexit__(self, kind: object, error: object, trace: object) -> None:
        with self._held:
            if error is None:
                self._stream.commit_current()
            await self._end()
            if self._cursor_file is not None:
                write_cursor(self._cursor_file, self.name, self._stream.cursor)

    @property
    def is_connected(self) -> bool:
        """Whether there is a connection to the broker."""
        return self._link.is_connected

    @property
    def absence(self) -> str:
        """Why nothing is known of the daemon now; empty while its messages arrive."""
        if not self.is_connected:
            return "no connection to the broker"
        status = self._statuses.latest
        seems_online = status is not None and status.online
        return SILENT if seems_online and self._pulse.is_silent else ""

    @property
    def cursor(self) -> dict[str, int]:
        """Next numbers by session, for ``since``.

        A point counts when the one after it is requested.
        """
        return self._stream.cursor

    @property
    def counters(self) -> Counters:
        """Counts of connections, points and losses so far."""
        return Counters(
            connections=self._link.connections,
            points=self._order.n_taken,
            duplicates=self._order.duplicates,
            resend_requested=self._order.n_requested,
            lost=self._stream.lost,
            undecodable=self._undecodable,
        )

    def points(self) -> PointIterator:
        """Points and retractions in order, none twice; for one reader at a time."""
        return PointIterator(self._stream)

    def points_and_losses(self) -> PointStream:
        """Iterate as `points`, with a `Lost` in the place of unavailable points."""
        return self._stream

    def events(self) -> Feed[Event]:
        """Iterate over events from now on."""
        return self._events.open()

    def doubts(self) -> Feed[LaterDoubt]:
        """Iterate over what is in doubt since it was sent, the known ones first.

        Points and blocks of scans that are handed on later have their flags.
        """
        return self._doubts.open()

    def clocks(self) -> Feed[Clock]:
        """Iterate over the daemon's clock, twice a second."""
        return self._clocks.open()

    def live(self) -> Feed[Live]:
        """Iterate over latest poses; a slow reader misses some."""
        self._run(self._link.add_topic(topics.live_topic(self.name), 0))
        return self._lives.open()

    async def scans(self) -> Feed[Scan]:
        """Iterate over blocks of all scans from now on, by any client."""
        await self._link.add_topic(topics.scan_topic(self.name), 0)
        return self._scans.open()

    def scan(
        self, mode: ScanMode = "time", **options: Unpack[ScanOptions]
    ) -> ScanBlocks:
        """Run a scan within an `async with`; iterate over its blocks.

        Arguments as of the command `scan`.
        """
        return ScanBlocks(
            self.scans, lambda: self.start_scan(mode, **options), self.stop_scan
        )

    async def status(self) -> Status:
        """Return the latest state of the arm; offline while nothing arrives from it.

        Raises:
            TimeoutError: none was ever published at this broker.
        """
        status = await self._statuses.first(self._reply_timeout_s)
        return as_offline(status) if self.absence else status

    async def published_status(self) -> Status:
        """Return the latest state that the daemon published, however long ago.

        It is offline while there is no connection. For programs that show silence in a
        way of their own.

        Raises:
            TimeoutError: none was ever published at this broker.
        """
        status = await self._statuses.first(self._reply_timeout_s)
        return status if self.is_connected else as_offline(status)

    async def health(self) -> Health:
        """Return the daemon's latest figures.

        Raises:
            TimeoutError: none were ever published at this broker.
        """
        return await self._healths.first(self._reply_timeout_s)

    def _take(self, arrived: IncomingMessage) -> None:
        kind = arrived.topic.split("/", 3)[2]
        try:
            self._kinds[kind](arrived)
        except MessageError as error:
            self._undecodable += 1
            log.warning("message on %s left out: %s", arrived.topic, error)
            if arrived.number:
                self._link.acknowledge(arrived.number)

    def _link_changed(self, is_connected: bool) -> None:
        if not is_connected:
            self._pulse.reset()
        self._requests.link_changed(is_connected)
        self._stream.link_changed(is_connected)

    def _take_clock(self, arrived: IncomingMessage) -> None:
        clock = decode(Clock, arrived.payload)
        self._pulse.beat()
        self._requests.take_clock(clock)
        self._clocks.put(clock)

    def _take_status(self, arrived: IncomingMessage) -> None:
        status = decode(Status, arrived.payload)
        self._doubts.take(status.doubts)
        self._statuses.put(status)
        if status.session is not None:
            self._stream.notice(status.session)
        self._requests.take_status(status)

    def _take_event(self, arrived: IncomingMessage) -> None:
        event = decode(Event, arrived.payload)
        self._link.acknowledge(arrived.number)
        self._events.put(event)

    def _take_point(self, arrived: IncomingMessage) -> None:
        point = decode(Point, arrived.payload)
        self.by_id.take(point)
        self._stream.take(point, arrived.number)

    def _close(self, error: BaseException | None = None) -> None:
        self._stream.close(error)
        for feeds in (
            *(self._statuses, self._healths, self._events),
            *(self._clocks, self._lives, self._scans, self._doubts.feeds),
        ):
            feeds.close(error)

    async def _save_cursor_periodically(self, path: Path) -> None:
        kept: dict[str, int] | None = None
        while True:
            cursor = self._stream.cursor
            if cursor != kept and self._order.sessions.has_begun:
                await asyncio.to_thread(write_cursor, path, self.name, cursor)
                kept = cursor
            await asyncio.sleep(CURSOR_PERIOD_S)

    def _run(self, work: Coroutine[Any, Any, None]) -> None:
        task = asyncio.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._done)

    def _done(self, task: asyncio.Task[None]) -> None:
        self._tasks.discard(task)
        if not task.cancelled() and task.exception() is not None:
            self._close(task.exception())

    async def _end(self) -> None:
        await cancel_tasks(self._tasks)
        self._close()
