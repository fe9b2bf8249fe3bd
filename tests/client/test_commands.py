"""Commands through the client, against a simulated daemon and a real broker."""

import asyncio
import time

import numpy as np
import pytest

from benchmarks.tools.network import Network
from tests.client.reading import PATIENCE_S, read
from tests.client.virtual_daemon import VirtualDaemon
from tests.protocol.message_examples import HEALTH, LIVE, POINT, SCAN
from traverse.client import Arm, CommandRefused, NoAnswerError
from traverse.protocol.messages import (
    AlignArgs,
    LabelArgs,
    PointArgs,
    ProbeArgs,
    ReloadArgs,
    ResendArgs,
    ScanArgs,
)
from traverse.testing.waiting import until

pytestmark = pytest.mark.needs("mosquitto")


async def test_capture_gives_the_point_and_undo_its_retraction(
    virtual: VirtualDaemon, broker: str
) -> None:
    async with virtual.running(), Arm(virtual.arm, broker) as arm:
        point = await arm.capture(samples=3)
        undone = await arm.undo()
        assert [point, undone] == virtual.points
        assert undone.retracts == point.id
        assert PointArgs(samples=3) in virtual.commands
        assert await read(arm, 2) == virtual.points


async def test_a_captured_point_that_does_not_arrive_is_requested(
    virtual: VirtualDaemon, broker: str
) -> None:
    async with virtual.running(), Arm(virtual.arm, broker) as arm:
        await virtual.take(1)
        virtual.is_mute = True
        capturing = asyncio.create_task(arm.capture())
        await until(lambda: len(virtual.points) == 2)
        virtual.is_mute = False
        assert await capturing == virtual.points[1]


async def test_every_command_is_carried_out(
    virtual: VirtualDaemon, broker: str
) -> None:
    async with virtual.running(), Arm(virtual.arm, broker) as arm:
        await arm.label("ball", "1")
        assert await arm.probe("ruby-3") == POINT.model
        assert await arm.reload() == POINT.model
        await arm.align(np.eye(3), np.array([1, 2, 3]), name="part")
        await arm.clear_alignment()
        await arm.stop_scan()
        rows = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
        shift = (1.0, 2.0, 3.0)
        expected = [
            LabelArgs(artefact="ball", feature="1"),
            ProbeArgs(name="ruby-3"),
            ReloadArgs(),
            AlignArgs(action="set", name="part", rotation=rows, translation_mm=shift),
            AlignArgs(action="clear"),
            ScanArgs(action="stop"),
        ]
        # It asks once by itself for what it has missed, whenever it is connected.
        answers = [
            command
            for command in virtual.commands
            if not isinstance(command, ResendArgs)
        ]
        assert answers == expected
        first, second = virtual.session, await arm.new_session("after lunch")
        assert second == virtual.session != first
        held = await arm.sessions()
        assert [session.session for session in held] == [first, second]
        assert held[0].begun_ns == virtual.begun_ns[first]
        assert (await arm.resend(first)).points == 0


async def test_a_refusal_says_code_text_and_remedy(
    virtual: VirtualDaemon, broker: str
) -> None:
    virtual.can_resend = False
    async with virtual.running(), Arm(virtual.arm, broker) as arm:
        with pytest.raises(CommandRefused) as refused:
            await arm.sessions()
        refusal = (refused.value.code, refused.value.text, refused.value.remedy)
        assert refusal == ("command.not_available", "cannot", "a new version")


async def test_a_command_is_answered_over_a_reconnection_and_carried_out_once(
    virtual: VirtualDaemon, network: Network
) -> None:
    async with virtual.running(), Arm(virtual.arm, f"localhost:{network.port}") as arm:
        network.swallow()
        capturing = asyncio.create_task(arm.capture())
        await asyncio.sleep(0)
        await network.cut()
        network.pass_on()
        async with asyncio.timeout(PATIENCE_S):
            point = await capturing
        assert [point] == virtual.points


async def test_a_capture_is_not_repeated_to_a_daemon_that_was_started_anew(
    virtual: VirtualDaemon, broker: str
) -> None:
    async with Arm(virtual.arm, broker, reply_timeout_s=2.0) as arm:
        virtual.is_deaf = True
        async with virtual.running():
            await until(lambda: virtual.session != "")
            assert (await arm.status()).online
            capturing = asyncio.create_task(arm.capture())
            labelling = asyncio.create_task(arm.label("ball"))
            await until(lambda: virtual.heard >= 2)
        virtual.is_deaf = False
        async with virtual.running():
            await labelling
            with pytest.raises(NoAnswerError, match="check the points"):
                await capturing
            assert virtual.points == []


async def test_an_arm_that_is_not_there_is_reported(
    virtual: VirtualDaemon, broker: str
) -> None:
    async with Arm(virtual.arm, broker, reply_timeout_s=0.2) as arm:
        with pytest.raises(NoAnswerError, match="check the name"):
            await arm.label("ball")
        async with virtual.running():
            pass
        await until(lambda: arm.counters.connections > 0)
        with pytest.raises(NoAnswerError, match="offline"):
            await arm.label("ball")


async def test_an_arm_is_offline_while_nothing_is_heard_of_it(
    virtual: VirtualDaemon, network: Network
) -> None:
    async with virtual.running(), Arm(virtual.arm, f"localhost:{network.port}") as arm:
        before = await arm.status()
        network.refuse()
        await network.cut()
        await until(lambda: not arm.is_connected)
        offline = {"online": False, "state": "offline", "alarms": (), "conditions": ()}
        assert await arm.status() == before.model_copy(update=offline)
        network.pass_on()
        await until(lambda: arm.is_connected)
        assert await arm.status() == before


def work_without_the_loop() -> None:
    time.sleep(2.0)


async def test_an_arm_whose_daemon_stands_still_is_offline_though_connected(
    virtual: VirtualDaemon, broker: str
) -> None:
    async with virtual.running(), Arm(virtual.arm, broker) as arm:
        assert (await arm.status()).state == "ready"
        virtual.is_stopped = True
        await until(lambda: arm.absence != "")
        assert arm.is_connected
        assert (await arm.status()).state == "offline"
        assert (await arm.published_status()).state == "ready"
        virtual.is_stopped = False
        await until(lambda: arm.absence == "")
        assert (await arm.status()).state == "ready"
        work_without_the_loop()
        assert (await arm.status()).state == "ready"


async def test_status_health_and_live_poses_come(
    virtual: VirtualDaemon, broker: str
) -> None:
    async with virtual.running(), Arm(virtual.arm, broker) as arm:
        assert (await arm.status()).session == virtual.session
        await virtual.publish(HEALTH)
        assert await arm.health() == HEALTH
        poses = arm.live()
        async with asyncio.timeout(PATIENCE_S):
            while (next_pose := asyncio.ensure_future(anext(poses))) and True:
                await virtual.publish(LIVE)
                done, _ = await asyncio.wait({next_pose}, timeout=0.1)
                if done:
                    break
                next_pose.cancel()
        assert next_pose.result() == LIVE


async def test_a_scan_runs_while_its_block_does_and_gaps_are_counted(
    virtual: VirtualDaemon, broker: str
) -> None:
    async with virtual.running(), Arm(virtual.arm, broker) as arm:
        async with arm.scan(rate_hz=100.0) as blocks:
            n = len(SCAN.dtime_ns)
            changed = {"seq": 0, "last": False, "total": None}
            first = SCAN.model_copy(update=changed)
            other = first.model_copy(update={"scan": "another"})
            second = first.model_copy(update={"seq": n + 7})
            last = first.model_copy(update={"seq": 2 * n + 7, "last": True, "total": 9})
            for block in (first, other, second, last):
                await virtual.publish(block)
            async with asyncio.timeout(PATIENCE_S):
                received = [block async for block in blocks]
        assert received == [first, second, last]
        assert blocks.missing == 7
        assert virtual.commands[-1] == ScanArgs(
            action="start",
            mode="time",
            rate_hz=100.0,
            spacing_mm=None,
            normal=None,
            offset_mm=0.0,
            held=False,
        )
        async with arm.scan(mode="distance", spacing_mm=0.5):
            pass
        assert virtual.commands[-1] == ScanArgs(action="stop")
