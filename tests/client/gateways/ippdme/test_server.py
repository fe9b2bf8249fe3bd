"""The server between a real socket and a real broker."""

import asyncio
import contextlib
import time
from collections.abc import AsyncIterator

import pytest

from tests.client.gateways.ippdme.client import IppClient
from tests.client.reading import PATIENCE_S
from tests.client.virtual_daemon import VirtualDaemon
from tests.protocol.message_examples import LIVE
from traverse.client import Arm
from traverse.client.cancel_tasks import cancel_tasks
from traverse.client.gateways.ippdme.options import Options
from traverse.client.gateways.ippdme.server import IppServer
from traverse.protocol.messages.quality import Quality
from traverse.testing.waiting import until

pytestmark = pytest.mark.needs("mosquitto")

GOOD = Quality.from_bits(0)


class Serving:
    """A server for a virtual arm, which publishes its pose again and again."""

    def __init__(self, virtual: VirtualDaemon) -> None:
        self.virtual = virtual
        self.reports: list[str] = []
        self.port = 0

    async def speak(self) -> None:
        while True:
            now = {"arm": self.virtual.arm, "time_ns": time.time_ns()}
            await self.virtual.publish(LIVE.model_copy(update=now))
            await asyncio.sleep(0.02)

    async def says(self, text: str) -> None:
        await until(lambda: any(text in reports for reports in self.reports))

    async def touch(self, *, quality: Quality = GOOD) -> None:
        self.virtual.is_mute = True
        (point,) = await self.virtual.take()
        held = self.virtual.outbox[point.session]
        held[point.seq] = point.model_copy(update={"quality": quality})
        await self.virtual.publish(held[point.seq])


@pytest.fixture
async def serving(virtual: VirtualDaemon, broker: str) -> AsyncIterator[Serving]:
    serving = Serving(virtual)
    virtual.probes = ("ball", "star")
    ready = asyncio.Event()
    async with virtual.running(), Arm(virtual.arm, broker) as arm:
        server = IppServer(arm, "127.0.0.1", 0, serving.reports.append, Options())
        tasks = [
            asyncio.create_task(server.serve(ready.set)),
            asyncio.create_task(serving.speak()),
        ]
        await asyncio.wait_for(ready.wait(), PATIENCE_S)
        serving.port = server.port
        yield serving
        await cancel_tasks(tasks)


async def posed(client: IppClient) -> str:
    assert await client.ask("StartSession()") == []
    while True:
        (line,) = await client.ask("Get(X(),Y(),Z())")
        if "Error" not in line:
            return line
        await client.ask("ClearAllErrors()")
        await asyncio.sleep(0.02)


async def waiting(client: IppClient, method: str) -> str:
    """Send a command until it waits: poses may be late on a busy computer."""
    while True:
        tag = client.send(method)
        await client.until(f"{tag} &")
        if await client.ask("GetErrStatusE()", fast=True) == ["ErrStatus(0)"]:
            return tag
        await client.ask("ClearAllErrors()")


async def test_touches_tools_and_daemons_over_the_network(serving: Serving) -> None:
    async with IppClient(serving.port, "network") as client:
        assert await posed(client) == "X(612.25),Y(-80.5),Z(301.125)"
        assert await client.ask('ChangeTool("star")') == []
        assert await client.ask("GetProp(Tool.Name())") == ['Tool.Name("star")']
        daemon = client.send("OnMoveReportE(Time(0.1),X())", fast=True)
        assert await client.until(f"{daemon} #") == f"{daemon} # X(612.25)"
        assert await client.ask("StopAllDaemons()") == []
        tag = await waiting(client, "PtMeas(X(612),Y(-80),Z(301))")
        await serving.touch()
        assert (
            await client.until(f"{tag} #") == f"{tag} # X(612.25),Y(-80.5),Z(301.125)"
        )
        await client.ask("EnableUser()")
        await serving.touch(quality=Quality(ok=False, flags=("singular",)))
        assert "1001" in await client.until("E0000")
        await serving.touch()
        expected = "E0000 # PtMeas(X(612.25),Y(-80.5),Z(301.125))"
        assert await client.until("E0000") == expected
        serving.virtual.probe = "ball"
        await serving.virtual.begin_session()
        assert await client.until("E0000") == 'E0000 # ChangeTool("ball")'
        assert await client.ask("EndSession()") == []


async def test_a_daemon_that_stands_still_is_reported_and_gives_no_pose(
    serving: Serving,
) -> None:
    async with IppClient(serving.port, "stopped") as client:
        await posed(client)
        serving.virtual.is_stopped = True
        error = await client.until("E0000")
        assert error.startswith("E0000 ! Error(1,0503,")
        (refusal,) = await client.ask("Get(X())")
        assert refusal.startswith("Error(3,0503,")
    await serving.says("nothing arrives from its daemon, which may be stopped")


async def test_a_second_client_is_told_why_and_the_next_gets_a_session(
    serving: Serving,
) -> None:
    async with IppClient(serving.port, "first") as first:
        await posed(first)
        first.send("PtMeas(X(0))")
        async with IppClient(serving.port, "second") as second:
            refusal = await second.reply()
            assert refusal.startswith('E0000 ! Error(3,0508,"Connect: 127.0.0.1:')
            assert await second.reply() == ""
        (answer,) = await first.ask("GetErrStatusE()", fast=True)
        assert answer.startswith("ErrStatus(")
    await serving.says("has disconnected; its session is over")
    await serving.touch()  # nobody is there: it stays in the outbox, and is said
    await serving.says("not sent: there is no session")
    async with IppClient(serving.port, "third") as third:
        await posed(third)
        assert await third.ask("StopAllDaemons()") == [
            'Error(1,0512,"StopAllDaemons","No daemons are active")'
        ]


async def test_hostile_bytes_end_in_an_error_or_the_end(serving: Serving) -> None:
    for data in (b"\xff\x00\r\n", b"A" * 70_000, b"00001 StartSession()\n"):
        reader, writer = await asyncio.open_connection("127.0.0.1", serving.port)
        writer.write(data)
        async with asyncio.timeout(PATIENCE_S):
            assert b"! Error(" in await reader.read(200)
        writer.close()
        with contextlib.suppress(OSError):
            await writer.wait_closed()
        await until(lambda: serving.reports[-1].endswith("its session is over"))
    assert any("its line has no end" in reports for reports in serving.reports)
