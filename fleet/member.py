"""A member of a group of consumers: puts its messages into the store.

A message is acknowledged once it is committed. What a member had when it died comes
again, to it or to another one, or is found missing in the store and asked for; the
store takes each once.
"""

import asyncio
import contextlib
import logging
import time
import uuid
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Concatenate, ParamSpec, TypeVar

from traverse.broker.address import BrokerAddress
from traverse.broker.packets import Property, Version
from traverse.client.cancel_tasks import run_together
from traverse.client.change_signal import ChangeSignal
from traverse.client.errors import ClientError, CommandRefused
from traverse.client.mqtt.connection import IncomingMessage, ReconnectingConnection
from traverse.client.points.gap_filler import CANNOT
from traverse.client.requests import CommandClient
from traverse.client.results import Resent, ResentScan
from traverse.fleet.database import BadValueError, Database, StoreAwayError
from traverse.fleet.gaps import Gap, find_gaps, mark_lost, take_lease
from traverse.fleet.rows import listed_series
from traverse.fleet.store import Store
from traverse.protocol import topics
from traverse.protocol.encoding import decode
from traverse.protocol.message_error import MessageError
from traverse.protocol.messages import Reply, ResendArgs, Status

log = logging.getLogger(__name__)

P = ParamSpec("P")
T = TypeVar("T")

SHARED = ("point", "event", "scan")
"""Kinds of messages that members share; of all others each gets every one."""
MOST_UNACKNOWLEDGED = 5000
MOST_WAITING = 20_000
"""Messages; four connections may break before one of them is dropped and counted."""
BATCH = 1000
SCAN_BATCH = 500
SCAN_WAIT_S = 10.0
FIRST_WAIT_S, LAST_WAIT_S = 0.2, 10.0
ASK_S = 5.0
RETRY_S = 1.0
LOSSES, LOSSES_S = 6, 10.0
"""So many lost connections in so short a time: two members have one name."""
LEASE_S = 30.0
NAME_LEASE_S, RENEWAL_S = 6.0, 2.0
"""A member that has ended without a word is known to have done so after this time."""


class NameTakenError(Exception):
    """Another member of the group has the same name."""


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
    asked: int = 0
    lost: int = 0


@dataclass(slots=True)
class _Queue:
    waiting: deque[IncomingMessage] = field(default_factory=deque)
    changed: ChangeSignal = field(default_factory=ChangeSignal)


@dataclass(slots=True)
class NameConflict:
    """Notices by lost connections that two members have one name.

    Not every broker tells that another client has the identifier: it ends a connection
    whenever the other one connects. The one that had been connected for long stays for
    twice as many losses, so that the other one ends.
    """

    connected_s: float
    _most: int = LOSSES
    _lost_s: deque[float] = field(default_factory=lambda: deque(maxlen=2 * LOSSES))

    def shows(self, lost_s: float) -> bool:
        """Count a lost connection; return whether there are too many."""
        if lost_s - self.connected_s >= LOSSES_S:
            self._most = 2 * LOSSES
        self._lost_s.append(lost_s)
        n_recent = sum(lost_s - earlier_s < LOSSES_S for earlier_s in self._lost_s)
        return n_recent >= self._most


class Member:
    """Takes messages until cancelled.

    Args:
        open_store: makes the store for one thread.
        database: for looking for gaps, in a thread of its own.
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
        self._database = database
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
        self._requests: dict[str, CommandClient] = {}
        self._online: dict[str, bool] = {}
        self._listed_s: dict[str, float] = {}
        self._asked_ns: dict[tuple[str, str, str], int] = {}  # by series with a gap
        self._is_away = False
        self._lease = f"name {settings.group}/{settings.member}"
        self._process = uuid.uuid4().hex
        self._query_lock = asyncio.Lock()
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
        await self._claim_name()
        await run_together(
            self._keep_name(),
            self.link.run(self._take, self._link_changed),
            self._write(self._messages, BATCH, 0.0),
            self._write(self._scans, SCAN_BATCH, SCAN_WAIT_S),
            self._look_for_gaps(),
            self._end_if_name_is_taken(),
            self._report_no_connection(),
        )

    async def _claim_name(self) -> None:
        """Claim the member's name at this database.

        A killed member leaves its claim behind, so this waits whether the claim is
        renewed, which is impossible while the database is away.

        Raises:
            NameTakenError: another process holds it.
        """
        loop = asyncio.get_running_loop()
        until_s = loop.time() + NAME_LEASE_S + RENEWAL_S
        is_reported = False
        while True:
            try:
                if await self._renew_name():
                    self._back()
                    return
            except StoreAwayError as error:
                self._away(str(error))
                until_s = loop.time() + NAME_LEASE_S + RENEWAL_S
                await asyncio.sleep(RETRY_S)
                continue
            if loop.time() > until_s:
                raise NameTakenError
            if not is_reported:
                self._report(
                    f"a member called {self._settings.member} is there, or has ended "
                    f"without a word; waiting up to {NAME_LEASE_S + RENEWAL_S:g} s "
                    "for it"
                )
            is_reported = True
            await asyncio.sleep(RETRY_S)

    async def _keep_name(self) -> None:
        while True:
            await asyncio.sleep(RENEWAL_S)
            with contextlib.suppress(StoreAwayError):  # writing reports that
                if not await self._renew_name():
                    raise NameTakenError

    async def _renew_name(self) -> bool:
        lease_ns = int(NAME_LEASE_S * 1e9)
        return await self._query(
            take_lease, self._lease, self._process, time.time_ns(), lease_ns
        )

    def release_name(self) -> None:
        """Release the name for another process; call it after `run`."""
        with contextlib.suppress(StoreAwayError):
            take_lease(self._database, self._lease, self._process, time.time_ns(), 0)

    async def _query(
        self,
        function: Callable[Concatenate[Database, P], T],
        *arguments: P.args,
        **options: P.kwargs,
    ) -> T:
        """Use the database in a thread, one at a time."""
        async with self._query_lock:
            return await asyncio.to_thread(
                function, self._database, *arguments, **options
            )

    def _take(self, message: IncomingMessage) -> None:
        queue = self._messages
        with contextlib.suppress(MessageError):
            topic = topics.parse_topic(message.topic)
            if topic.kind == "scan":
                queue = self._scans
            elif topic.kind == "reply":
                self._answered(topic.arm, message.payload)
                message.acknowledge(message.number)
                return
            elif topic.kind == "status":
                self._heard(topic.arm, message.payload)
        if len(queue.waiting) >= MOST_WAITING:
            # Those with a number are the broker's still, for the next connection.
            self.counts.dropped += 1
            return
        queue.waiting.append(message)
        queue.changed.notify()

    def _answered(self, arm: str, payload: bytes) -> None:
        with contextlib.suppress(MessageError):
            self._requests_to(arm).take_reply(decode(Reply, payload))

    def _heard(self, arm: str, payload: bytes) -> None:
        status = decode(Status, payload)
        if status.online and not self._online.get(arm):
            self._listed_s.pop(arm, None)  # it may have taken points without a broker
        self._online[arm] = status.online
        self._requests_to(arm).take_status(status)

    def _requests_to(self, arm: str) -> CommandClient:
        return self._requests.setdefault(arm, CommandClient(arm, self.link))

    def _link_changed(self, is_connected: bool) -> None:
        # What is redelivered has other numbers: it is stored once all the same.
        for requests in self._requests.values():
            requests.link_changed(is_connected)
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
                    self._away(str(error))
                    await asyncio.sleep(wait_again_s)
                    wait_again_s = min(2 * wait_again_s, LAST_WAIT_S)
            self._back()
            self.counts.stored += len(batch)
            for message in batch:
                if message.number:
                    message.acknowledge(message.number)

    def _away(self, reason: str) -> None:
        if not self._is_away:
            self._report(f"{reason}; messages wait at the broker, and this tries again")
        self._is_away = True

    def _back(self) -> None:
        if self._is_away:
            self._report(f"{self._database.name} is back")
        self._is_away = False

    async def _look_for_gaps(self) -> None:
        """Request missing numbers from arms, one member at a time."""
        settings = self._settings
        pause_s = max(0.2, min(settings.gap_s / 4, LEASE_S / 3))
        me = f"{settings.group}/{settings.member}"
        while True:
            await asyncio.sleep(pause_s)
            if not self.link.is_connected:
                continue
            try:
                now_ns = time.time_ns()
                if not await self._query(
                    take_lease, "gaps", me, now_ns, int(LEASE_S * 1e9)
                ):
                    continue
                await self._list_arms()
                gaps = await self._query(find_gaps, now_ns)
                await self._ask_for(gaps, now_ns)
            except StoreAwayError as error:
                log.info("gaps are looked for later: %s", error)

    async def _list_arms(self) -> None:
        """Ask arms which points they have, so that a lost last one is noticed too."""
        now_s = asyncio.get_running_loop().time()
        due = [
            arm
            for arm, is_online in self._online.items()
            if is_online
            and now_s - self._listed_s.get(arm, -1e9) >= self._settings.list_s
        ]
        for arm, listed in await self._answers({arm: ResendArgs() for arm in due}):
            self._listed_s[arm] = now_s
            if isinstance(listed, CommandRefused):
                continue
            try:
                await self._query(listed_series, arm, listed)
            except (MessageError, BadValueError) as error:
                log.warning("%s lists what cannot be: %s", arm, error)

    async def _ask_for(self, gaps: list[Gap], now_ns: int) -> None:
        """Ask each arm for one gap of each series; further gaps follow next time.

        A series that an arm never answers for must not hold up its others.
        """
        asked_ns = {g.series: self._asked_ns.get(g.series, 0) for g in gaps}
        first: dict[str, Gap] = {}
        for gap in sorted(gaps, key=lambda gap: asked_ns[gap.series]):
            if now_ns - gap.since_ns >= self._settings.gap_s * 1e9:
                first.setdefault(gap.arm, gap)
        asked_ns.update((gap.series, now_ns) for gap in first.values())
        self._asked_ns = asked_ns
        requests = {
            arm: ResendArgs(
                session=None if gap.scan else gap.session,
                scan=gap.scan or None,
                from_seq=gap.from_seq,
                to_seq=gap.to_seq,
            )
            for arm, gap in first.items()
            if self._online.get(arm)
        }
        self.counts.asked += len(requests)
        for arm, answer in await self._answers(requests):
            try:
                await self._write_off(first[arm], answer, now_ns)
            except (MessageError, BadValueError) as error:
                log.warning("%s answers what cannot be: %s", arm, error)

    async def _answers(
        self, requests: Mapping[str, ResendArgs]
    ) -> list[tuple[str, Mapping[str, Any] | CommandRefused]]:
        """Query these arms concurrently; those without an answer are left out."""

        async def answer(arm: str) -> Mapping[str, Any] | CommandRefused | None:
            try:
                return await self._requests_to(arm).result(requests[arm], ASK_S)
            except CommandRefused as error:
                log.info("%s does not send again: %s", arm, error)
                return error
            except ClientError as error:
                log.info("%s: %s", arm, error)
                return None

        answers = await asyncio.gather(*map(answer, requests))
        return [
            (arm, listed)
            for arm, listed in zip(requests, answers, strict=True)
            if listed is not None
        ]

    async def _write_off(
        self, gap: Gap, answer: Mapping[str, Any] | CommandRefused, now_ns: int
    ) -> None:
        """Note numbers that the arm no longer has."""
        reason = "the arm does not have them any more"
        if isinstance(answer, CommandRefused):
            if not gap.scan or answer.code not in CANNOT:
                return  # points may be had later
            last_lost, reason = gap.to_seq, str(answer)
        else:
            if gap.scan:
                scan = ResentScan.read(answer)
                n_sent, first = scan.blocks, scan.first_seq
            else:
                session = Resent.read(answer)
                n_sent, first = session.points, session.first_seq
            last_lost = gap.to_seq
            if n_sent and first is not None:
                last_lost = min(last_lost, first - 1)
            if last_lost < gap.from_seq:
                return
        await self._lose(replace(gap, to_seq=last_lost), now_ns, reason)

    async def _lose(self, gap: Gap, now_ns: int, reason: str) -> None:
        series = f"scan {gap.scan}" if gap.scan else f"session {gap.session}"
        for first, last in await self._query(mark_lost, gap, now_ns, reason):
            self.counts.lost += last - first + 1
            self._report(f"{gap.arm}, {series}: {first} to {last} are lost: {reason}")
