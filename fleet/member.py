"""A member of a group of consumers: puts its messages into the store.

A message is acknowledged once it is committed. What a member had when it died comes
again, to it or to another one, or is found missing in the store and asked for; the
store takes each once.
"""

import asyncio
import contextlib
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

from traverse.broker.address import BrokerAddress
from traverse.broker.packets import Property, Version
from traverse.client.cancel_tasks import run_together
from traverse.client.change_signal import ChangeSignal
from traverse.client.mqtt.connection import IncomingMessage, ReconnectingConnection
from traverse.fleet.database import Database, StoreAwayError
from traverse.fleet.gap_requests import GapRequests
from traverse.fleet.member_name import NameClaim, NameConflict, NameTakenError
from traverse.fleet.query_thread import Outage, QueryThread
from traverse.fleet.store import Store
from traverse.protocol import topics
from traverse.protocol.message_error import MessageError

SHARED = ("point", "event", "scan")
"""Kinds of messages that members share; of all others each gets every one."""
MOST_UNACKNOWLEDGED = 5000
MOST_WAITING = 20_000
"""Messages; four connections may break before one of them is dropped and counted."""
BATCH = 1000
SCAN_BATCH = 500
SCAN_WAIT_S = 10.0
FIRST_WAIT_S, LAST_WAIT_S = 0.2, 10.0


@dataclass(frozen=True, slots=True, kw_only=True)
class MemberSettings:
    """How a member works.

    Attributes:
        member: unique in the group, the same after a restart.
        gap_s: after this time a missing number is asked for.
        list_s: interval at which an arm is asked which points it has.
        keep_s: how long the broker keeps messages for a member that is away.
    """

    group: str = "store"
    member: str
    gap_s: float = 60.0
    list_s: float = 600.0
    keep_s: int = 3600


@dataclass(slots=True)
class MemberCounts:
    """Since the member began."""

    stored: int = 0
    dropped: int = 0


@dataclass(slots=True)
class _Queue:
    waiting: deque[IncomingMessage] = field(default_factory=deque)
    changed: ChangeSignal = field(default_factory=ChangeSignal)


class Member:
    """Takes messages until cancelled.

    Args:
        open_store: makes the store for one thread.
        database: for looking for gaps, in a thread of its own.

    Attributes:
        name: to be released after `run`.
    """

    def __init__(
        self,
        address: BrokerAddress,
        settings: MemberSettings,
        open_store: Callable[[], Store],
        database: Database,
        report: Callable[[str], None],
    ) -> None:
        self._settings = settings
        self._open_store = open_store
        self._report = report
        self.link = ReconnectingConnection(
            address,
            identifier=f"traverse-{settings.group}-{settings.member}",
            version=Version.V5,
            clean_start=False,
            connect_properties={
                Property.SESSION_EXPIRY_S: settings.keep_s,
                Property.RECEIVE_MAXIMUM: MOST_UNACKNOWLEDGED,
            },
        )
        for kind in SHARED:
            self.link.topics[f"$share/{settings.group}/{topics.kind_filter(kind)}"] = 1
        for kind in ("status", "health"):
            self.link.topics[topics.kind_filter(kind)] = topics.CHANNELS[kind].qos
        self.link.topics[f"{topics.ROOT}/+/reply/resend"] = 1
        self._messages, self._scans = _Queue(), _Queue()
        self._outage = Outage(database.name, report)
        queries = QueryThread(database)
        self.name = NameClaim(
            settings.group, settings.member, queries, self._outage, report
        )
        self.gaps = GapRequests(
            self.link, queries, report, gap_s=settings.gap_s, list_s=settings.list_s
        )
        self._stores: list[Store] = []
        self._conflict = NameConflict(time.monotonic())
        self._name_is_taken = asyncio.Event()
        self.counts = MemberCounts()

    @property
    def n_refused(self) -> int:
        return sum(store.n_refused for store in self._stores)

    async def run(self) -> None:
        """Work, until cancelled.

        Raises:
            NameTakenError: another member has the same name.
            StoreRefusedError: the database refuses a statement.
        """
        settings = self._settings
        await self.name.claim()
        await run_together(
            self.name.keep(),
            self.link.run(self._take, self._link_changed),
            self._write(self._messages, BATCH, 0.0),
            self._write(self._scans, SCAN_BATCH, SCAN_WAIT_S),
            self.gaps.run(f"{settings.group}/{settings.member}"),
            self._end_if_name_is_taken(),
            self._report_no_connection(),
        )

    def _take(self, message: IncomingMessage) -> None:
        queue = self._messages
        with contextlib.suppress(MessageError):
            topic = topics.parse_topic(message.topic)
            if topic.kind == "scan":
                queue = self._scans
            elif topic.kind == "reply":
                self.gaps.take_reply(topic.arm, message.payload)
                message.acknowledge(message.number)
                return
            elif topic.kind == "status":
                self.gaps.take_status(topic.arm, message.payload)
        if len(queue.waiting) >= MOST_WAITING:
            # Those with a number are the broker's still, for the next connection.
            self.counts.dropped += 1
            return
        queue.waiting.append(message)
        queue.changed.notify()

    def _link_changed(self, is_connected: bool) -> None:
        # What is redelivered has other numbers: it is stored once all the same.
        self.gaps.link_changed(is_connected)
        now_s = time.monotonic()
        if is_connected:
            self._conflict.connected_s = now_s
            self._report(f"connected to {self.link.address}")
        elif self._conflict.shows(now_s):
            self._name_is_taken.set()

    async def _report_no_connection(self) -> None:
        reported = ""
        while True:
            await asyncio.sleep(1.0)
            reason = "" if self.link.is_connected else self.link.reason
            if reason not in ("", reported):
                self._report(f"broker {self.link.address}: {reason}; tries again")
            reported = reason

    async def _end_if_name_is_taken(self) -> None:
        await self._name_is_taken.wait()
        raise NameTakenError

    async def _write(self, queue: _Queue, most: int, wait_s: float) -> None:
        """Write batches, each as often as it takes."""
        store = await asyncio.to_thread(self._open_store)
        self._stores.append(store)
        while True:
            while not queue.waiting:
                await queue.changed.wait()
            loop = asyncio.get_running_loop()
            until_s = loop.time() + wait_s
            while len(queue.waiting) < most and (left_s := until_s - loop.time()) > 0:
                await queue.changed.wait(left_s)
            batch = [
                queue.waiting.popleft() for _ in range(min(most, len(queue.waiting)))
            ]
            wait_again_s = FIRST_WAIT_S
            while True:
                try:
                    await asyncio.to_thread(store.write, batch)
                    break
                except StoreAwayError as error:
                    self._outage.begin(str(error))
                    await asyncio.sleep(wait_again_s)
                    wait_again_s = min(2 * wait_again_s, LAST_WAIT_S)
            self._outage.end()
            self.counts.stored += len(batch)
            for message in batch:
                if message.number:
                    message.acknowledge(message.number)
