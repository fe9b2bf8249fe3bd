"""A subscriber that keeps all messages of an arm."""

import asyncio
import contextlib
import uuid
from collections.abc import AsyncIterator
from typing import Any

import numpy as np

from tests.end_to_end.programs import PATIENCE_S
from traverse.broker.address import BrokerAddress
from traverse.broker.errors import MqttError
from traverse.client.cancel_tasks import cancel_tasks
from traverse.client.mqtt.connection import ConfiguredClient
from traverse.client.mqtt.subscription import KINDS, received, subscribe
from traverse.protocol import topics
from traverse.protocol.encoding import encode
from traverse.protocol.messages import (
    Args,
    Command,
    Event,
    Health,
    Live,
    Point,
    ReferenceArgs,
    Reply,
    Scan,
    ScanArgs,
    Status,
)
from traverse.testing.waiting import until


class Listener:
    """Messages in the order of arrival, by kind.

    Attributes:
        points: Where acknowledgements may be lost, those that are repeated are not kept
            again; each must be as it was.
    """

    def __init__(self, client: Any, arm: str) -> None:
        self.client = client
        self._arm = arm
        self._requests = 0
        self._name = uuid.uuid4().hex[:8]  # requests are not those of another listener
        self.connected = False
        self.may_miss_acknowledgements = False
        self.points: list[Point] = []
        self.scans: list[Scan] = []
        self.live_ns: list[int] = []
        self.events: list[Event] = []
        self.statuses: list[Status] = []
        self.healths: list[Health] = []
        self.replies: dict[str, Reply] = {}
        self.errors: list[str] = []

    def take(self, message: object) -> None:
        match message:
            case Point():
                earlier = [p for p in self.points if p.id == message.id]
                if not (earlier and self.may_miss_acknowledgements):
                    self.points.append(message)
                elif message not in earlier:
                    self.errors.append(f"{message} was {earlier}")
            case Scan():
                self.scans.append(message)
            case Live():
                self.live_ns.append(message.time_ns)
            case Event():
                self.events.append(message)
            case Status():
                self.statuses.append(message)
            case Health():
                self.healths.append(message)
            case Reply():
                self.replies[message.request] = message

    async def command(self, args: Args, request: str = "") -> Reply:
        """Send a command and wait for its answer on reply/<name>.

        It is sent again where an outage has just ended, as the refusal advises.
        """
        reply = await self._command(args, request)
        while reply.error is not None and "until just now" in reply.error.text:
            await asyncio.sleep(0.2)
            reply = await self._command(args, "")
        return reply

    async def _command(self, args: Args, request: str) -> Reply:
        self._requests += 1
        command = Command.carrying(args, request or f"{self._name}-{self._requests}")
        topic = topics.command_topic(self._arm, args.command)
        await self.client.publish(topic, encode(command, "msgpack"), qos=1)
        await until(
            lambda: command.request in self.replies, f"an answer to {args.command}"
        )
        return self.replies[command.request]

    async def ready(self, state: str | None = "ready") -> None:
        """Wait until numbers of the arm are ok, and confirm for that as an operator.

        Without an identified geometry they stay in ``state`` "doubt"; None: in either.
        """

        def waits_for_the_operator() -> bool:
            return self.statuses[-1].state == "doubt" and any(
                condition.command and not condition.established
                for condition in self.statuses[-1].conditions
            )

        await until(
            lambda: (
                self.statuses
                and (self.statuses[-1].state == "ready" or waits_for_the_operator())
            ),
            "a status that is ready, or in doubt",
        )
        if self.statuses[-1].state != "ready":
            confirmed = await self.command(ReferenceArgs(action="confirm"))
            assert confirmed.ok, confirmed
        if state is not None:
            await until(lambda: self.statuses[-1].state == state, f"a status {state}")

    async def n_points(self, n: int, timeout_s: float = PATIENCE_S) -> None:
        awaited = f"{n} points"
        await until(lambda: len(self.points) >= n, awaited, timeout_s)

    async def event(
        self, code: str, active: bool | None = None, timeout_s: float = PATIENCE_S
    ) -> Event:
        await until(lambda: self.events_of(code, active), f"event {code}", timeout_s)
        return self.events_of(code, active)[-1]

    def events_of(self, code: str, active: bool | None = None) -> list[Event]:
        return [e for e in self.events if e.code == code and e.active is active]

    async def start_scan(self, rate_hz: float | None = None, **args: Any) -> str:
        started = await self.command(ScanArgs(action="start", rate_hz=rate_hz, **args))
        assert started.ok, started
        return str((started.result or {})["scan"])

    async def stop_scan(self, scan: str) -> list[Scan]:
        stopped = await self.command(ScanArgs(action="stop"))
        blocks = await self.scan_ended(scan)
        assert stopped.result == {"scan": scan, "total": blocks[-1].total}
        return blocks

    async def scan_points(
        self, scan: str, n: int, timeout_s: float = PATIENCE_S
    ) -> None:
        await until(
            lambda: any(
                s.scan == scan and s.seq + len(s.dtime_ns) >= n for s in self.scans
            ),
            f"point {n} of scan {scan}",
            timeout_s,
        )

    async def scan_ended(self, scan: str) -> list[Scan]:
        await until(
            lambda: any(s.scan == scan and s.last for s in self.scans),
            f"the end of scan {scan}",
        )
        return [s for s in self.scans if s.scan == scan]


@contextlib.asynccontextmanager
async def listening(
    host: str, port: int, arm: str, kinds: tuple[str, ...] = tuple(KINDS)
) -> AsyncIterator[Listener]:
    """Follow an arm while the block lasts; reconnect when the broker returns.

    ``client`` of the listener is of the present connection.
    """
    listener = Listener(None, arm)

    async def follow() -> None:
        while True:
            try:
                async with ConfiguredClient(BrokerAddress(host, port)) as client:
                    await subscribe(client, arm, kinds)
                    listener.client = client
                    listener.connected = True
                    async for item in received(client):
                        if item.error is not None:
                            listener.errors.append(f"{item.kind}: {item.error}")
                        listener.take(item.message)
            except (MqttError, OSError):
                listener.connected = False
                await asyncio.sleep(0.05)  # until the broker is back

    following = asyncio.create_task(follow())
    try:
        await until(lambda: listener.connected, f"a broker on {host}:{port}")
        yield listener
        if following.done():
            following.result()
    finally:
        await cancel_tasks([following])
    assert listener.errors == []


def numbers(blocks: list[Scan]) -> np.ndarray:
    of_blocks = [s.seq + np.arange(len(s.dtime_ns)) for s in blocks]
    return np.concatenate([np.zeros(0, np.int64), *of_blocks])


def times_ns(blocks: list[Scan]) -> np.ndarray:
    """Times of all points of some blocks [UTC]."""
    return np.concatenate([s.time_ns + np.asarray(s.dtime_ns) for s in blocks])
