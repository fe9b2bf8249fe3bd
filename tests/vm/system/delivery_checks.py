"""Points reach the consumer through failures of the broker and the daemon."""

import asyncio
import contextlib
import json
import re
from collections.abc import Callable
from functools import partial

from tests.end_to_end.listener import Listener
from tests.vm.system import unit
from tests.vm.system.pedal import Pedal
from traverse.daemon.commands.expiry import EXPIRED
from traverse.protocol.messages import Args, PointArgs, Reply, ResendArgs
from traverse.testing.waiting import until

SOON_S = 150.0
MEASURING = ("ready", "doubt")  # with all devices; the arm is not identified
N_POINTS = 3
PATIENCE_S = 8.0
TRIES = 5  # emulated encoders answer late now and then


class Delivery:
    def __init__(self, listener: Listener, pedal: Pedal) -> None:
        self._listener = listener
        self._pedal = pedal
        self._acknowledged: set[str] = set()

    async def arrive(self) -> str:
        """The pedal is pressed, and we ask."""
        for n in range(N_POINTS):
            await self._press_until(partial(self._has_pressed, n + 1))
            await self._ask()
        await until(lambda: self._by("command") >= N_POINTS, "asked points", SOON_S)
        return f"{self._by('button')} by pedal, {self._by('command')} by command"

    async def wait_for_broker(self) -> str:
        """Points pressed without a broker are delivered afterwards."""
        await asyncio.to_thread(unit.systemctl, "stop", "mosquitto")
        n = self._by("button")
        await self._press_until(lambda: _waiting() >= N_POINTS)
        status_text = unit.shown("StatusText")
        await asyncio.to_thread(unit.systemctl, "start", "mosquitto")
        await until(self._is_connected, "the broker again", SOON_S)
        summary = await self._asked_for_all()
        assert self._by("button") >= n + N_POINTS
        return f"{summary}; meanwhile: {status_text}"

    async def lose_broker(self) -> str:
        """mosquitto forgets when it is killed; the outbox does not."""
        await self.acknowledge()
        pid = unit.systemctl("show", "mosquitto", "--property=MainPID", "--value")
        self._listener.connected = False
        unit.run("kill", "-9", pid)
        await until(self._is_connected, "the broker again", SOON_S)
        return await self._asked_for_all()

    async def lose_nothing(self) -> str:
        """Points that were acknowledged before the daemon was killed are delivered."""
        summary = await self._asked_for_all()
        missing = self._acknowledged - {p.id for p in self._listener.points}
        assert not missing, f"{len(missing)} of {len(self._acknowledged)} missing"
        return f"{summary}; {len(self._acknowledged)} acknowledged to us, all there"

    async def acknowledge(self) -> None:
        """Ask for points, so that something happens right after the answer."""
        for _ in range(N_POINTS):
            await self._ask()

    async def go_on(self) -> str:
        """A start after an orderly end: a new session, and points."""
        await asyncio.to_thread(unit.systemctl, "start", unit.NAME)
        await until(
            lambda: self._listener.statuses[-1].state in MEASURING, "ready", SOON_S
        )
        await self._ask()
        return await self._asked_for_all()

    async def _press_until(self, is_done: Callable[[], bool]) -> None:
        """Press, again where a point was refused, as an operator does."""
        for _ in range(N_POINTS * TRIES):
            await self._pedal.press()
            with contextlib.suppress(AssertionError):
                await unit.until(is_done, "a point", PATIENCE_S)
                return
        assert is_done(), f"{self._pedal.n_pressed} presses"

    async def _ask(self) -> None:
        for _ in range(TRIES):
            reply = await self._command(PointArgs())
            if reply.ok:
                break
        assert reply.ok, reply.error
        assert reply.result is not None
        self._acknowledged.add(str(reply.result["id"]))

    async def _command(self, args: Args) -> Reply:
        """Send a command, again if broker or daemon were gone meanwhile."""
        for _ in range(TRIES):
            with contextlib.suppress(AssertionError):
                reply = await self._listener.command(args)
                # One that was sent before the daemon was back may have been late.
                if reply.error is None or reply.error.code != EXPIRED:
                    return reply
        return await self._listener.command(args)

    async def _asked_for_all(self) -> str:
        """Contents of the outbox; requests missing points, as a consumer does."""
        reply = await self._command(ResendArgs())
        assert reply.result is not None, reply.error
        sessions = {
            str(row["session"]): range(int(row["first_seq"]), int(row["last_seq"]) + 1)
            for row in json.loads(json.dumps(reply.result["sessions"]))
            if row["first_seq"] is not None
        }
        n_asked = 0
        for session, held in sessions.items():
            n_asked += len(set(held) - self._numbers(session))
            if set(held) - self._numbers(session):
                await self._command(ResendArgs(session=session))
            await until(self._has(session, held), f"all of {session}", SOON_S)
        points = {p.id: p for p in self._listener.points}
        numbers = {(p.session, p.seq) for p in points.values()}
        assert len(numbers) == len(points), "two points of one number"
        held_all = {(s, n) for s, held in sessions.items() for n in held}
        assert numbers == held_all, f"{len(numbers)} came, {len(held_all)} are held"
        return (
            f"{len(points)} points of {len(sessions)} session(s), all that the outbox "
            f"holds, {n_asked} of them asked for"
        )

    def _has_pressed(self, n: int) -> bool:
        return self._by("button") >= n

    def _has(self, session: str, held: range) -> Callable[[], bool]:
        return lambda: set(held) <= self._numbers(session)

    def _numbers(self, session: str) -> set[int]:
        return {p.seq for p in self._listener.points if p.session == session}

    def _by(self, trigger: str) -> int:
        return len({p.id for p in self._listener.points if p.trigger == trigger})

    def _is_connected(self) -> bool:
        return self._listener.connected


def _waiting() -> int:
    """Points that the broker does not have, by the unit's status."""
    match = re.search(r"(\d+) points? waits?", unit.shown("StatusText"))
    return int(match[1]) if match else 0
