"""Missing numbers: found in the store, and requested from their arms."""

import asyncio
import contextlib
import logging
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from traverse.client.errors import ClientError, CommandRefused
from traverse.client.mqtt.connection import ReconnectingConnection
from traverse.client.points.gap_filler import CANNOT
from traverse.client.requests import CommandClient
from traverse.client.results import Resent, ResentScan
from traverse.fleet.database import BadValueError, StoreAwayError
from traverse.fleet.gaps import Gap, find_gaps, mark_lost, take_lease
from traverse.fleet.query_thread import QueryThread
from traverse.fleet.rows import listed_series
from traverse.protocol.encoding import decode
from traverse.protocol.message_error import MessageError
from traverse.protocol.messages import Reply, ResendArgs, Status

log = logging.getLogger(__name__)

ASK_S = 5.0
LEASE_S = 30.0


class GapRequests:
    """Requests missing points and blocks, and notes those that are lost.

    Args:
        gap_s: after this time a missing number is asked for.
        list_s: interval at which an arm is asked which points it has.

    Attributes:
        asked: gaps that were asked for.
        lost: numbers that their arms do not have any more.
    """

    def __init__(
        self,
        link: ReconnectingConnection,
        queries: QueryThread,
        report: Callable[[str], None],
        *,
        gap_s: float,
        list_s: float,
    ) -> None:
        self._link = link
        self._queries = queries
        self._report = report
        self._gap_s, self._list_s = gap_s, list_s
        self._requests: dict[str, CommandClient] = {}
        self._online: dict[str, bool] = {}
        self._listed_s: dict[str, float] = {}
        self._asked_ns: dict[tuple[str, str, str], int] = {}  # by series with a gap
        self.asked = self.lost = 0

    def take_reply(self, arm: str, payload: bytes) -> None:
        with contextlib.suppress(MessageError):
            self._requests_to(arm).take_reply(decode(Reply, payload))

    def take_status(self, arm: str, payload: bytes) -> None:
        status = decode(Status, payload)
        if status.online and not self._online.get(arm):
            self._listed_s.pop(arm, None)  # it may have taken points without a broker
        self._online[arm] = status.online
        self._requests_to(arm).take_status(status)

    def _requests_to(self, arm: str) -> CommandClient:
        return self._requests.setdefault(arm, CommandClient(arm, self._link))

    def link_changed(self, is_connected: bool) -> None:
        for requests in self._requests.values():
            requests.link_changed(is_connected)

    async def run(self, member: str) -> None:
        """Request missing numbers until cancelled, one member at a time."""
        pause_s = max(0.2, min(self._gap_s / 4, LEASE_S / 3))
        while True:
            await asyncio.sleep(pause_s)
            if not self._link.is_connected:
                continue
            try:
                now_ns = time.time_ns()
                if not await self._queries.run(
                    take_lease, "gaps", member, now_ns, int(LEASE_S * 1e9)
                ):
                    continue
                await self._list_arms()
                gaps = await self._queries.run(find_gaps, now_ns)
                await self._ask_for(gaps, now_ns)
            except StoreAwayError as error:
                log.info("gaps are looked for later: %s", error)

    async def _list_arms(self) -> None:
        """Ask arms which points they have, so that a lost last one is noticed too."""
        now_s = asyncio.get_running_loop().time()
        due = [
            arm
            for arm, is_online in self._online.items()
            if is_online and now_s - self._listed_s.get(arm, -1e9) >= self._list_s
        ]
        for arm, listed in await self._answers({arm: ResendArgs() for arm in due}):
            self._listed_s[arm] = now_s
            if isinstance(listed, CommandRefused):
                continue
            try:
                await self._queries.run(listed_series, arm, listed)
            except (MessageError, BadValueError) as error:
                log.warning("%s lists what cannot be: %s", arm, error)

    async def _ask_for(self, gaps: list[Gap], now_ns: int) -> None:
        """Ask each arm for one gap of each series; further gaps follow next time.

        A series that an arm never answers for must not hold up its others.
        """
        asked_ns = {g.series: self._asked_ns.get(g.series, 0) for g in gaps}
        first: dict[str, Gap] = {}
        for gap in sorted(gaps, key=lambda gap: asked_ns[gap.series]):
            if now_ns - gap.since_ns >= self._gap_s * 1e9:
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
        self.asked += len(requests)
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
        for first, last in await self._queries.run(mark_lost, gap, now_ns, reason):
            self.lost += last - first + 1
            self._report(f"{gap.arm}, {series}: {first} to {last} are lost: {reason}")
