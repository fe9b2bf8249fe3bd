"""The client of an arm against a simulated daemon and a real broker."""

import asyncio
import uuid
from collections.abc import AsyncIterator

import pytest

from benchmarks.network import Network
from clients import Arm
from protocol.messages import Point
from tests.clients.virtual_daemon import VirtualDaemon
from tests.mosquitto import Mosquitto

pytestmark = pytest.mark.broker
PATIENCE_S = 20.0


@pytest.fixture
def virtual(mosquitto: Mosquitto) -> VirtualDaemon:
    """A daemon of an arm whose name no other test uses; not yet running."""
    name = f"arm-{uuid.uuid4().hex[:8]}"
    return VirtualDaemon(name, mosquitto.host, mosquitto.port)


@pytest.fixture
async def network(mosquitto: Mosquitto) -> AsyncIterator[Network]:
    """Between client and broker."""
    async with Network(mosquitto.port) as network:
        yield network


async def read(arm: Arm, n: int) -> list[Point]:
    """The next points, in the order in which they are handed out."""
    found: list[Point] = []
    async with asyncio.timeout(PATIENCE_S):
        while len(found) < n:
            found.append(await anext(arm.points()))
    return found


async def test_points_come_as_they_are_taken(
    virtual: VirtualDaemon, mosquitto: Mosquitto
) -> None:
    async with (
        virtual.running(),
        Arm(virtual.arm, f"localhost:{mosquitto.port}") as arm,
    ):
        taken = await virtual.take(5)
        assert await read(arm, 5) == taken
        assert arm.counters.duplicates == 0


async def test_no_point_is_lost_or_doubled_over_twenty_reconnections(
    virtual: VirtualDaemon, network: Network
) -> None:
    async with virtual.running(), Arm(virtual.arm, f"localhost:{network.port}") as arm:

        async def cut_and_take() -> None:
            for _ in range(20):
                await virtual.take(100)
                await network.cut()

        cutting = asyncio.create_task(cut_and_take())
        found = await read(arm, 2000)
        await cutting
        assert found == virtual.points
        assert arm.counters.lost == 0
