"""A daemon that is stopped while its connection stays: who reads it says so soon."""

import asyncio
import signal
import time

import pytest

from benchmarks.tools.network import Network
from tests.end_to_end.measuring import measuring, measuring_over
from tests.end_to_end.programs import Program
from tests.end_to_end.workbench import Workbench
from traverse.client import Arm
from traverse.testing.waiting import until

pytestmark = pytest.mark.needs("mosquitto")

SOON_S = 5.0  # far below the 22 s after which the broker publishes the will


async def test_a_stopped_daemon_is_offline_for_programs_and_gateways(
    resting: Workbench,
) -> None:
    broker = f"{resting.host}:{resting.port}"
    options = ("--arm-name", resting.arm, "--broker", broker)
    async with measuring(resting) as (_, _, daemon), Arm(resting.arm, broker) as arm:
        lines = (*options, "--file", "lines.txt")
        with Program(resting.folder, "lines", "gateway", "lines", *lines) as gateway:
            await gateway.says("lines.txt")
            await asyncio.sleep(1.0)  # the clock has come
            assert (await arm.status()).online
            daemon.process.send_signal(signal.SIGSTOP)
            begun_s = time.monotonic()
            await until(lambda: arm.absence != "", "silence is noticed", SOON_S)
            assert (await arm.status()).state == "offline"
            await gateway.says("which may be stopped; no line comes", SOON_S)
            assert time.monotonic() - begun_s < SOON_S
            daemon.process.send_signal(signal.SIGCONT)
            await gateway.says(f"{resting.arm}: it is there")
            assert (await arm.status()).online
            await gateway.stop()


async def test_a_daemon_that_ends_while_the_broker_comes_back_is_offline(
    resting: Workbench,
) -> None:
    async with (
        Network(resting.port) as network,
        measuring_over(network, resting) as (listener, _, daemon),
    ):
        network.refuse()
        await network.cut()
        await daemon.says("broker.lost")
        await until(lambda: not listener.statuses[-1].online, "the will")
        daemon.process.send_signal(signal.SIGTERM)
        await daemon.says("stopping")
        network.pass_on()
        assert await daemon.ended() == 0
        async with Arm(resting.arm, f"{resting.host}:{resting.port}") as arm:
            assert (await arm.published_status()).state == "offline"
