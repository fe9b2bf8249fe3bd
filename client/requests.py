"""Requests: sent, repeated if harmless, answered.

A command may be lost on either side of the broker. It is sent again, with the same
`request`, whenever a connection or the arm is there again: the daemon answers a
repeated request with its first reply. A restarted daemon remembers no requests, so a
command that acts each time is not repeated to it.

Each command states until when it may be begun, by the daemon's own clock: after our
time-out it is refused wherever it was delayed.
"""

import asyncio
import contextlib
import time
import uuid
from collections import deque
from collections.abc import Mapping
from typing import Any

from traverse.broker.errors import MqttError
from traverse.client.change_signal import ChangeSignal
from traverse.client.errors import CommandRefused, NoAnswerError
from traverse.client.mqtt.connection import ReconnectingConnection
from traverse.protocol.encoding import encode
from traverse.protocol.messages import (
    Args,
    Clock,
    Command,
    Expiry,
    Reply,
    ScanArgs,
    Status,
)
from traverse.protocol.topics import ROOT, command_topic

MOST_READINGS = 8


class DaemonClock:
    """The clock of an arm's daemon, by its latest messages.

    Each message was written before it arrived, so the clock shows at least the quickest
    of them.
    """

    def __init__(self) -> None:
        self._name: str | None = None
        self._ahead_ns: deque[int] = deque(maxlen=MOST_READINGS)

    def take(self, clock: Clock) -> None:
        if clock.clock != self._name:
            self._name = clock.clock
            self._ahead_ns.clear()
        self._ahead_ns.append(clock.now_ns - time.monotonic_ns())

    def expiry(self, monotonic_ns: int) -> Expiry | None:
        """Convert an instant of ours to that clock; None if unknown."""
        if self._name is None:
            return None
        return Expiry(
            clock=self._name, at_ns=max(0, monotonic_ns + max(self._ahead_ns))
        )


class CommandClient:
    """Sends commands to one arm."""

    def __init__(self, arm: str, link: ReconnectingConnection) -> None:
        self._arm = arm
        self._link = link
        self._name = uuid.uuid4().hex[:12]
        self._number = 0
        self._waiting: dict[str, asyncio.Future[Reply]] = {}
        self._status: Status | None = None
        self._clock = DaemonClock()
        self._news = ChangeSignal()
        self._has_answered = False

    def take_clock(self, clock: Clock) -> None:
        self._clock.take(clock)

    def take_reply(self, reply: Reply) -> None:
        """Take an answer, to one of our requests or to another client's."""
        self._has_answered = True
        future = self._waiting.get(reply.request)
        if future is not None and not future.done():
            future.set_result(reply)

    def take_status(self, status: Status) -> None:
        self._status = status
        self._news.notify()

    def link_changed(self, is_connected: bool) -> None:
        if not is_connected:  # the arm's last status may be out of date
            self._status = None
        self._news.notify()

    async def result(
        self, args: Args, answer_s: float, valid_s: float | None = None
    ) -> Mapping[str, Any]:
        """Execute a command; return its result.

        Args:
            args: of the command.
            answer_s: time limit of the answer.
            valid_s: validity of the command; None: the same.

        Raises:
            CommandRefused: it was not executed, with the reason.
            NoAnswerError: there was no answer in time.
        """
        self._number += 1
        request = f"{self._name}-{self._number}"
        valid_ns = round((answer_s if valid_s is None else valid_s) * 1e9)
        until_ns = time.monotonic_ns() + valid_ns
        answer = asyncio.get_running_loop().create_future()
        self._waiting[request] = answer
        try:
            async with asyncio.timeout(answer_s):
                reply = await self._reply(args, request, until_ns, answer)
        except TimeoutError as error:
            raise NoAnswerError(self._timeout_reason(args.command, answer_s)) from error
        finally:
            del self._waiting[request]
            answer.cancel()
        if (refusal := reply.error) is not None:
            raise CommandRefused(refusal.code, refusal.text, refusal.remedy)
        return reply.result or {}

    async def _reply(
        self, args: Args, request: str, until_ns: int, answer: asyncio.Future[Reply]
    ) -> Reply:
        is_stop = isinstance(args, ScanArgs) and args.action == "stop"
        may_repeat = is_stop or args.is_repeatable
        topic = command_topic(self._arm, args.command)
        daemon_session: str | None = None
        was_sent = False
        while not answer.done():
            status, beats = self._status, self._news.beats
            if status is not None and status.online and self._link.is_connected:
                daemon_session = daemon_session or status.session
                if may_repeat or not was_sent or status.session == daemon_session:
                    was_sent = True
                    expires = self._clock.expiry(until_ns)
                    command = Command.carrying(args, request, expires)
                    payload = encode(command, "msgpack")
                    with contextlib.suppress(MqttError):
                        await self._link.publish(topic, payload)
            if beats != self._news.beats:
                continue  # there was news while this was sent
            news = asyncio.ensure_future(self._news.wait())
            try:
                awaited: set[asyncio.Future[Any]] = {answer, news}
                await asyncio.wait(awaited, return_when=asyncio.FIRST_COMPLETED)
            finally:
                news.cancel()
        return answer.result()

    def _timeout_reason(self, command: str, answer_s: float) -> str:
        failure = f"command {command} to {self._arm}: no answer within {answer_s:g} s"
        if not self._link.is_connected:
            return (
                f"{failure}; no connection to {self._link.address}: {self._link.reason}"
            )
        if self._status is None:
            return (
                f"{failure}; no arm of this name has ever published a status at the "
                f"broker {self._link.address}: check the name, and start the daemon"
            )
        if not self._status.online:
            return f"{failure}; the arm is offline: start its daemon"
        if not self._has_answered:
            failure += (
                ", nor to any other: do the broker's access lists let the arm read "
                f"{ROOT}/{self._arm}/cmd/#, and this program its reply/#?"
            )
        return (
            f"{failure}; it may have been executed, and will not be any more: check "
            "the points before you send it again"
        )
