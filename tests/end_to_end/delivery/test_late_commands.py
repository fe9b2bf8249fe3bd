import asyncio
import signal
import time

import aiomqtt
import pytest
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties

from benchmarks.tools.network import Network
from tests.end_to_end.listener import Listener
from tests.end_to_end.measuring import measuring, measuring_over
from tests.end_to_end.workbench import Workbench
from traverse.client import Arm, NoAnswerError
from traverse.daemon.commands.expiry import EXPIRED, SETTLING_S, VALID_S
from traverse.protocol.encoding import encode
from traverse.protocol.messages import Command, PointArgs
from traverse.testing.waiting import until

WANTED = "after the instant until which its sender wanted it"

pytestmark = pytest.mark.needs("mosquitto")


async def press(bench: Workbench, request: str, expiry_s: int | None = None) -> None:
    """Ask for a point as any program does that knows nothing of the clock."""
    properties = Properties(PacketTypes.PUBLISH)
    if expiry_s is not None:
        properties.MessageExpiryInterval = expiry_s
    payload = encode(Command.carrying(PointArgs(), request), "json")
    topic = f"traverse/{bench.arm}/cmd/point"
    async with aiomqtt.Client(
        bench.host, bench.port, protocol=aiomqtt.ProtocolVersion.V5
    ) as client:
        await client.publish(topic, payload, 1, properties=properties)


async def answer(listener: Listener, request: str) -> str:
    await until(lambda: request in listener.replies, f"an answer to {request}")
    error = listener.replies[request].error
    return "ok" if error is None else error.code


def refusals(listener: Listener) -> str:
    errors = (reply.error for reply in listener.replies.values())
    return "\n".join(error.text for error in errors if error is not None)


@pytest.mark.slow
async def test_commands_to_a_stopped_daemon_are_refused_when_it_wakes(
    resting: Workbench,
) -> None:
    async with (
        measuring(resting) as (listener, _, daemon),
        Arm(resting.arm, f"{resting.host}:{resting.port}", reply_timeout_s=2.0) as arm,
    ):
        assert (await arm.capture()).seq == 0
        daemon.process.send_signal(signal.SIGSTOP)
        begun_s = time.monotonic()
        await press(resting, "early")
        await press(resting, "long", expiry_s=60)
        with pytest.raises(NoAnswerError, match="will not be any more"):
            await arm.capture()
        left_s = VALID_S + 0.5 - (time.monotonic() - begun_s)
        await asyncio.sleep(max(0.0, left_s))  # a stopped process has no clock to set
        daemon.process.send_signal(signal.SIGCONT)
        assert await answer(listener, "early") == EXPIRED
        # Its sender has stated a minute, of which the broker keeps account.
        assert await answer(listener, "long") == "ok"
        await until(lambda: WANTED in refusals(listener), "the answer to the client")
        assert (await arm.capture()).seq == 2  # none of the two others was executed


@pytest.mark.slow
async def test_commands_on_a_network_that_stood_are_refused(resting: Workbench) -> None:
    async with (
        Network(resting.port) as network,
        measuring_over(network, resting) as (listener, _, _),
    ):
        network.swallow()
        await press(resting, "held", expiry_s=1)
        await asyncio.sleep(3.0)  # shorter than what ends the connection
        network.pass_on()
        assert await answer(listener, "held") == EXPIRED
        await press(resting, "settling")
        assert await answer(listener, "settling") == EXPIRED
        await asyncio.sleep(SETTLING_S)
        await press(resting, "later")
        assert await answer(listener, "later") == "ok"
        assert len(listener.points) == 1


@pytest.mark.slow
async def test_commands_to_a_lost_connection_are_answered(resting: Workbench) -> None:
    async with (
        Network(resting.port) as network,
        measuring_over(network, resting) as (listener, _, _),
    ):
        network.refuse()
        await network.cut()
        await press(resting, "held")
        await asyncio.sleep(VALID_S + 0.5)
        network.pass_on()
        assert await answer(listener, "held") == EXPIRED
        assert not listener.points
        await asyncio.sleep(SETTLING_S)
        await press(resting, "later")
        assert await answer(listener, "later") == "ok"


async def test_a_command_held_between_its_sender_and_the_broker_is_refused(
    resting: Workbench,
) -> None:
    async with Network(resting.port) as network, measuring(resting) as (listener, *_):
        address = f"127.0.0.1:{network.port}"
        async with Arm(resting.arm, address, reply_timeout_s=1.0) as arm:
            assert (await arm.capture()).seq == 0
            network.swallow()
            with pytest.raises(NoAnswerError):
                await arm.capture()
            network.pass_on()
            await until(lambda: WANTED in refusals(listener), "the late answer")
            assert len(listener.points) == 1
