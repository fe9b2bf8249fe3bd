"""An arm's daemon as its clients see it: speaks MQTT by the contract.

It keeps its points in an outbox of its own, and can be made to lose its connection, to
forget old points, to publish nothing, or to be started anew.
"""

import asyncio
import contextlib
import time
import uuid
from collections.abc import AsyncIterator
from typing import Any

import aiomqtt

from tests.protocol.message_examples import POINT, SCAN, STATUS
from traverse.client.cancel_tasks import cancel_tasks
from traverse.protocol import topics
from traverse.protocol.encoding import decode, encode, parse_args
from traverse.protocol.messages import (
    Args,
    Clock,
    Command,
    CovarianceArgs,
    HomeArgs,
    Message,
    Point,
    PointArgs,
    ProbeArgs,
    RecordArgs,
    ReferenceArgs,
    Reply,
    ReplyError,
    ResendArgs,
    ScanArgs,
    SessionArgs,
    Status,
    UndoArgs,
)
from traverse.protocol.messages.later_doubt import LaterDoubt

RECORDED = {"file": "a.mcap", "seconds": 0.1, "bytes": 9, "messages": 4, "gaps": 0}


class VirtualDaemon:
    """One arm on a broker.

    Attributes:
        outbox: points by session, then by number; sessions in the order of their begin.
        probe, probes, doubts: as in its status.
        earlier_doubts: in its list of sessions only.
        is_mute: points go into the outbox only.
        can_resend: whether the command is supported.
        is_deaf: commands are not carried out.
        is_stopped: nothing is published by itself, while the connection stays.
        heard: received commands.
        commands: carried out.
        resends: requested ranges.
        scans: listed as held; none of them is ever sent again.
        shared_mm: factors of the command `covariance`, by point, or by a reading's
            angles.
    """

    def __init__(self, arm: str, host: str, port: int, **options: Any) -> None:
        self.arm = arm
        self._where = (host, port)
        self._options = options
        self._client: aiomqtt.Client | None = None
        self._answers: dict[str, Reply] = {}
        self.outbox: dict[str, dict[int, Point]] = {}
        self.begun_ns: dict[str, int] = {}
        self.session = ""
        self.probe: str | None = None
        self.probes: tuple[str, ...] | None = None
        self.doubts: tuple[LaterDoubt, ...] = ()
        self.earlier_doubts: tuple[LaterDoubt, ...] = ()
        self.is_mute = False
        self.is_deaf = False
        self.is_stopped = False
        self.heard = 0
        self.can_resend = True
        self.commands: list[Args] = []
        self.resends: list[tuple[str | None, int, int | None]] = []
        self.scans: tuple[dict[str, Any], ...] = ()
        self.shared_mm: dict[object, list[list[float]]] = {}

    @property
    def points(self) -> list[Point]:
        """All points that were ever taken and are not forgotten, in order."""
        return [point for held in self.outbox.values() for point in held.values()]

    @contextlib.asynccontextmanager
    async def running(self) -> AsyncIterator["VirtualDaemon"]:
        """The daemon's life: a session of its own, online until the end."""
        self._answers.clear()
        will = aiomqtt.Will(
            topics.status_topic(self.arm), self._status(online=False), 1, True
        )
        async with aiomqtt.Client(
            *self._where, will=will, timeout=5, **self._options
        ) as client:
            client.pending_calls_threshold = 100_000
            self._client = client
            await client.subscribe(topics.command_filter(self.arm), qos=1)
            await self.begin_session()
            tasks = [
                asyncio.create_task(work)
                for work in (self._listen(client), self._tick())
            ]
            try:
                yield self
            finally:
                await cancel_tasks(tasks)
                await self._say_status(online=False)
                self._client = None

    async def _tick(self) -> None:
        """Publish the clock twice a second, unless the daemon is stopped."""
        name = uuid.uuid4().hex
        while True:
            if not self.is_stopped:
                now_ns = time.monotonic_ns()
                await self.publish(Clock(arm=self.arm, clock=name, now_ns=now_ns))
            await asyncio.sleep(0.5)

    async def begin_session(self) -> str:
        self.session = uuid.uuid4().hex
        self.outbox[self.session] = {}
        self.begun_ns[self.session] = time.time_ns()
        await self._say_status(online=True)
        return self.session

    async def take(self, n: int = 1, age_s: float = 0.0) -> list[Point]:
        """Take points, by their times a while ago: into the outbox, and out."""
        points = [self._next_point(age_s=age_s) for _ in range(n)]
        if not self.is_mute:
            await asyncio.gather(*map(self.publish, points))
        return points

    async def publish(self, message: Message) -> None:
        """Say something on the topic of its kind."""
        kind = type(message).__name__.lower()
        await self.publish_raw(kind, encode(message, "msgpack"))

    async def publish_raw(self, kind: str, payload: bytes) -> None:
        channel = topics.CHANNELS[kind]
        assert self._client is not None
        topic = f"{topics.ROOT}/{self.arm}/{kind}"
        await self._client.publish(
            topic, payload, qos=channel.qos, retain=channel.retained
        )

    def forget(self, session: str, below: int) -> None:
        """Drop old points, as retention does."""
        for seq in [seq for seq in self.outbox[session] if seq < below]:
            del self.outbox[session][seq]

    def _next_point(self, retracts: str | None = None, age_s: float = 0.0) -> Point:
        held = self.outbox[self.session]
        seq = max(held, default=-1) + 1
        fields = {name: getattr(POINT, name) for name in type(POINT).model_fields}
        del fields["schema_"]
        fields |= {
            "session": self.session,
            "seq": seq,
            "id": f"{self.session}-{seq}",
            "arm": self.arm,
            "time_ns": time.time_ns() - round(age_s * 1e9),
            "retracts": retracts,
        }
        held[seq] = Point(**fields)
        return held[seq]

    def _status(self, *, online: bool) -> bytes:
        fields = {name: getattr(STATUS, name) for name in type(STATUS).model_fields}
        del fields["schema_"]
        fields |= {
            "arm": self.arm,
            "online": online,
            "state": "ready" if online else "offline",
            "session": self.session or None,
            "alarms": (),
            "conditions": (),
            "doubts": self.doubts,
            "probe": self.probe,
            "probes": self.probes,
            "label": None,
        }
        return encode(Status(**fields), "msgpack")

    async def put_in_doubt(self, doubt: LaterDoubt) -> None:
        """Say what is in doubt since it was sent."""
        self.doubts += (doubt,)
        await self._say_status(online=True)

    async def _say_status(self, *, online: bool) -> None:
        assert self._client is not None
        topic, payload = topics.status_topic(self.arm), self._status(online=online)
        await self._client.publish(topic, payload, qos=1, retain=True)

    async def _listen(self, client: aiomqtt.Client) -> None:
        async for message in client.messages:
            self.heard += 1
            if self.is_deaf:
                continue
            assert isinstance(message.payload, bytes)
            name = topics.parse_topic(str(message.topic)).command or ""
            command = decode(Command, message.payload)
            reply = self._answers.get(command.request)
            if reply is None:
                reply = await self._carry_out(
                    command.request, parse_args(name, command.args)
                )
                self._answers[command.request] = reply
            topic = topics.reply_topic(self.arm, name)
            await client.publish(topic, encode(reply, "msgpack"), qos=1)

    async def _carry_out(self, request: str, args: Args) -> Reply:
        self.commands.append(args)
        result: dict[str, Any] = {}
        match args:
            case CovarianceArgs():
                result = self._covariance(args)
            case ResendArgs() if not self.can_resend:
                error = ReplyError(
                    code="command.not_available", text="cannot", remedy="a new version"
                )
                return Reply(request=request, ok=False, error=error)
            case ResendArgs():
                result = self._resend(args)
            case PointArgs():
                (point,) = await self.take()
                result = {"session": point.session, "seq": point.seq, "id": point.id}
            case UndoArgs():
                last = list(self.outbox[self.session].values())[-1]
                undone = self._next_point(last.id)
                await self.publish(undone)
                result = {"session": undone.session, "seq": undone.seq, "id": undone.id}
            case SessionArgs():
                result = {"session": await self.begin_session()}
            case RecordArgs():
                file = {"file": f"{args.name}.mcap"}
                result = file if args.action == "start" else RECORDED
            case ScanArgs():
                result = {"scan": SCAN.scan, "rate_hz": args.rate_hz}
            case ProbeArgs():
                self.probe = args.name
                await self._say_status(online=True)
                result = {"probe": args.name, "model": POINT.model}
            case HomeArgs():
                result = {"homed": ["J1"]}
            case ReferenceArgs():
                result = {"confirmed": ["base"], "accepted": ["base"]}
            case _:
                result = {"model": POINT.model}
        return Reply(request=request, ok=True, result=result)

    def _covariance(self, args: CovarianceArgs) -> dict[str, Any]:
        if args.readings:
            shared_mm = [self.shared_mm[r.angles_rad] for r in args.readings]
            return {"model": args.model, "with_arm": True, "shared_mm": shared_mm}
        held = {point.id: point for point in self.points}
        return {
            "model": held[args.ids[0]].model,
            "with_arm": True,
            "points": [
                {
                    "id": name,
                    "xyz_mm": list(held[name].xyz_mm),
                    "covariance_mm2": list(held[name].covariance_mm2 or ()),
                    "shared_mm": self.shared_mm[name],
                }
                for name in args.ids
            ],
        }

    def _resend(self, args: ResendArgs) -> dict[str, Any]:
        self.resends.append((args.session, args.from_seq, args.to_seq))
        if args.session is None:
            held_sessions = [self._held(session) for session in self.outbox]
            return {
                "sessions": held_sessions,
                "scans": list(self.scans),
                "doubts": [doubt.data for doubt in self.earlier_doubts],
            }
        held = self.outbox.get(args.session, {})
        last = max(held, default=-1) if args.to_seq is None else args.to_seq
        points = [p for seq, p in held.items() if args.from_seq <= seq <= last]
        sending = asyncio.gather(*map(self.publish, points))
        sending.add_done_callback(lambda done: done.cancelled() or done.exception())
        known = self._held(args.session)
        del known["begun_ns"]
        return known | {
            "from_seq": args.from_seq,
            "to_seq": args.to_seq,
            "points": len(points),
        }

    def _held(self, session: str) -> dict[str, Any]:
        held = self.outbox.get(session, {})
        return {
            "session": session,
            "begun_ns": str(self.begun_ns.get(session, 0)),
            "first_seq": min(held, default=None),
            "last_seq": max(held, default=None),
        }
