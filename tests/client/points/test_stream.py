"""Points through the client, against a simulated daemon and a real broker."""

import asyncio
import json
import os
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest

from benchmarks.tools.network import Network
from tests.client.display.values import doubt
from tests.client.reading import read
from tests.client.virtual_daemon import VirtualDaemon
from tests.mosquitto import Mosquitto, free_port
from tests.protocol.message_examples import EVENT
from traverse.client import Arm, BrokerUnreachableError
from traverse.protocol.message_error import MessageError
from traverse.testing.waiting import until

pytestmark = pytest.mark.needs("mosquitto")


async def test_the_whole_session_comes_and_nothing_of_those_before(
    virtual: VirtualDaemon, broker: str
) -> None:
    async with virtual.running():
        await virtual.take(3)
        session = await virtual.begin_session()
        await virtual.take(4)
        virtual.forget(session, 1)  # what is held no more is no loss of this reader
        async with Arm(virtual.arm, broker, since="session") as arm:
            await virtual.take(1)
            points = await read(arm, 4)
            assert points == list(virtual.outbox[session].values())
            assert arm.counters.lost == 0


async def test_what_is_in_doubt_since_it_was_sent_is_marked(
    virtual: VirtualDaemon, broker: str
) -> None:
    async with virtual.running():
        sent = await virtual.take(3)
        async with Arm(virtual.arm, broker) as early:
            await virtual.take(1)
            await read(early, 1)
            later = doubt(points=sent[1].id)
            await virtual.put_in_doubt(later)
            async with asyncio.timeout(5.0):
                assert await anext(early.doubts()) == later
        virtual.earlier_doubts = (doubt(points=sent[2].id),)
        async with Arm(virtual.arm, broker, since="session") as arm:
            marked = await read(arm, 4)
            async with asyncio.timeout(5.0):
                feed = arm.doubts()
                assert [await anext(feed), await anext(feed)] == [
                    later,
                    *virtual.earlier_doubts,
                ]
        are_stale = ["stale" in point.quality.flags for point in marked]
        assert are_stale == [False, True, True, False]


async def test_no_point_is_lost_or_doubled_over_twenty_reconnections(
    virtual: VirtualDaemon, network: Network
) -> None:
    async with virtual.running(), Arm(virtual.arm, f"localhost:{network.port}") as arm:

        async def cut_and_take() -> None:
            for _ in range(20):
                await virtual.take(20)
                before = arm.counters.connections
                await network.cut()
                await virtual.take(30)
                await until(partial(is_back, arm, before))

        cutting = asyncio.create_task(cut_and_take())
        points = await read(arm, 1000)
        await cutting
        assert points == virtual.points
        assert arm.counters.lost == 0


def is_back(arm: Arm, before: int) -> bool:
    return arm.counters.connections > before


async def test_what_a_broker_forgot_is_requested(
    virtual: VirtualDaemon, broker: str
) -> None:
    async with virtual.running(), Arm(virtual.arm, broker) as arm:
        await virtual.take(2)
        virtual.is_mute = True
        await virtual.take(3)
        virtual.is_mute = False
        await virtual.take(1)
        assert await read(arm, 6) == virtual.points
        assert virtual.resends[-1] == (virtual.session, 2, 4)
        # Counted with the answer, which follows the points.
        await until(lambda: arm.counters.resend_requested == 3)


async def test_a_place_file_continues_where_the_reader_stopped(
    virtual: VirtualDaemon, broker: str, tmp_path: Path
) -> None:
    file = tmp_path / "place.json"
    async with virtual.running():
        await virtual.take(3)
        async with Arm(virtual.arm, broker, cursor_file=file) as arm:
            await virtual.take(4)
            await read(arm, 2)
            with pytest.raises(OSError, match="another program keeps its place in it"):
                await Arm(virtual.arm, broker, cursor_file=file).__aenter__()
        assert os.listdir(tmp_path) == ["place.json"]  # and no lock
        await virtual.take(1)
        async with Arm(virtual.arm, broker, cursor_file=file) as arm:
            assert await read(arm, 3) == virtual.points[5:]
        with pytest.raises(RuntimeError, match="while reading"):
            await read_and_fail(virtual, Arm(virtual.arm, broker, cursor_file=file))
        async with Arm(virtual.arm, broker, cursor_file=file) as arm:
            assert await read(arm, 1) == virtual.points[-1:]
    with pytest.raises(MessageError, match="give it its own file"):
        Arm("another", broker, cursor_file=file)
    file.write_text(json.dumps({"schema": "traverse/place/1", "arm": "x"}))
    with pytest.raises(MessageError, match="sessions"):
        Arm("x", broker, cursor_file=file)


async def read_and_fail(virtual: VirtualDaemon, arm: Arm) -> None:
    async with arm:
        await virtual.take(1)
        await read(arm, 1)
        raise RuntimeError("while reading")


async def test_a_slow_reader_loses_nothing(virtual: VirtualDaemon, broker: str) -> None:
    async with virtual.running(), Arm(virtual.arm, broker, max_waiting=100) as arm:
        await read_one_after(virtual, arm)
        await virtual.take(1500)  # more than a broker keeps for one client
        assert await read(arm, 1500) == virtual.points[1:]
        assert len(virtual.points) == 1501


async def read_one_after(virtual: VirtualDaemon, arm: Arm) -> None:
    await virtual.take(1)
    await read(arm, 1)


async def test_events_continue_where_nobody_reads_points(
    virtual: VirtualDaemon, broker: str
) -> None:
    async with virtual.running(), Arm(virtual.arm, broker, max_waiting=10) as arm:
        events = arm.events()
        await virtual.take(100)
        await virtual.publish(EVENT)
        async with asyncio.timeout(10):
            assert await anext(events) == EVENT
        assert await read(arm, 100) == virtual.points


async def test_a_broker_killed_and_started_again_loses_nothing(
    make_mosquitto: Callable[[], Mosquitto],
) -> None:
    broker = make_mosquitto()
    virtual = VirtualDaemon("bench-7", broker.host, broker.port)
    async with Arm(virtual.arm, f"localhost:{broker.port}", since={}) as arm:
        for _ in range(2):
            async with virtual.running():
                await virtual.take(10)
                virtual.is_mute = True
                await virtual.take(10)
                virtual.is_mute = False
            broker.kill()
            broker.start()
        async with virtual.running():
            assert await read(arm, 40) == virtual.points


async def test_a_broker_that_is_not_there_is_reported_with_a_remedy() -> None:
    port = free_port()
    arm = Arm("bench-7", f"localhost:{port}", connect_timeout_s=0.3)
    with pytest.raises(BrokerUnreachableError, match=f"localhost:{port}.*start it"):
        async with arm:
            pass


async def test_what_cannot_be_understood_is_counted_and_left_out(
    virtual: VirtualDaemon, broker: str
) -> None:
    async with virtual.running(), Arm(virtual.arm, broker) as arm:
        await virtual.publish_raw("point", b"\xffrubbish")
        captured = await virtual.take(1)
        assert await read(arm, 1) == captured
        assert arm.counters.undecodable == 1
