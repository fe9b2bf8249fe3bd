"""Points reach the consumer, whatever happens to the broker and to the daemon."""

import asyncio
from functools import partial

from protocol.messages import PointArgs, ResendArgs
from tests.end_to_end.listener import Listener
from tests.end_to_end.programs import until
from tests.vm.system import unit

SOON_S = 60.0
N_POINTS = 3


class Delivery:
    """Checks in the order in which they are made."""

    def __init__(self, listener: Listener) -> None:
        self._listener = listener
        self._acknowledged: set[str] = set()

    async def arrive(self) -> str:
        """The simulated operator presses, and we ask."""
        await until(lambda: self._by("button") >= N_POINTS, "pressed points", SOON_S)
        for _ in range(N_POINTS):
            await self._ask()
        await until(lambda: self._by("command") >= N_POINTS, "asked points", SOON_S)
        return f"{self._by('button')} by button, {self._by('command')} by command"

    async def wait_for_broker(self) -> str:
        """What is pressed while there is no broker comes afterwards."""
        await asyncio.to_thread(unit.systemctl, "stop", "mosquitto")
        n = len(self._listener.points)
        await asyncio.sleep(12.0)
        told = unit.shown("StatusText")
        await asyncio.to_thread(unit.systemctl, "start", "mosquitto")
        await self._listener.n_points(n + 2, SOON_S)
        await self._settled()
        return f"{self._whole()}; meanwhile: {told}"

    async def lose_broker(self) -> str:
        """mosquitto forgets when it is killed; the outbox does not."""
        pid = unit.systemctl("show", "mosquitto", "--property=MainPID", "--value")
        for _ in range(N_POINTS):
            await self._ask()
        unit.run("kill", "-9", pid)
        self._listener.connected = False
        await until(lambda: self._listener.connected, "the broker again", SOON_S)
        await self._settled()
        return self._whole()

    async def lose_nothing(self) -> str:
        """Points that were acknowledged before the daemon was killed have come."""
        await self._settled()
        missing = self._acknowledged - {p.id for p in self._listener.points}
        assert not missing, f"{len(missing)} of {len(self._acknowledged)} missing"
        return f"{self._whole()}; {len(self._acknowledged)} acknowledged to us"

    async def _ask(self) -> None:
        reply = await self._listener.command(PointArgs())
        assert reply.ok, reply
        assert reply.result is not None
        self._acknowledged.add(str(reply.result["id"]))

    async def _settled(self) -> None:
        """Ask for what is missing, as a consumer does, until there is no gap."""
        for session in dict.fromkeys(p.session for p in self._listener.points):
            if not self._is_whole(session):
                reply = await self._listener.command(ResendArgs(session=session))
                assert reply.ok, reply
            whole = partial(self._is_whole, session)
            await until(whole, f"no gap in {session}", SOON_S)

    def _is_whole(self, session: str) -> bool:
        there = {p.seq for p in self._listener.points if p.session == session}
        return len(there) == max(there) + 1

    def _whole(self) -> str:
        """How many points there are, of how many sessions, each whole."""
        points = {p.id: p for p in self._listener.points}
        sessions = dict.fromkeys(p.session for p in points.values())
        numbers = {(p.session, p.seq) for p in points.values()}
        assert len(numbers) == len(points), "two points of one number"
        again = len(self._listener.points) - len(points)
        return (
            f"{len(points)} points of {len(sessions)} session(s), no gap, "
            f"{again} came again"
        )

    def _by(self, trigger: str) -> int:
        return sum(p.trigger == trigger for p in self._listener.points)
