import asyncio

import aiomqtt
import pytest
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties

from tests.end_to_end.arm_matrices import MatrixArm
from tests.end_to_end.measuring import measuring
from tests.end_to_end.programs import PATIENCE_S
from tests.end_to_end.workbench import Workbench
from traverse.protocol import topics
from traverse.protocol.encoding import decode, encode
from traverse.protocol.messages import Command, PointArgs, Reply

pytestmark = pytest.mark.needs("mosquitto")


async def test_a_point_is_taken_on_command_and_the_answer_names_it(
    resting: Workbench,
) -> None:
    async with measuring(resting) as (listener, _, _):
        answers = [await listener.command(PointArgs()) for _ in range(3)]
        await listener.n_points(3)
    assert all(a.ok for a in answers)
    named = [(a.result or {})["id"] for a in answers]
    assert [p.id for p in listener.points] == named
    assert [p.seq for p in listener.points] == [0, 1, 2]
    assert {p.trigger for p in listener.points} == {"command"}
    arm = MatrixArm(resting.arm_file)
    for point in listener.points:
        assert point.xyz_mm == pytest.approx(arm.pose(point.counts)[0], abs=1e-9)


async def test_mqtt_5_answers_go_to_the_response_topic(resting: Workbench) -> None:
    resting.write_daemon(broker='response_topics = ["elsewhere/+"]')
    properties = Properties(PacketTypes.PUBLISH)
    properties.ResponseTopic = f"elsewhere/{resting.arm}"
    properties.CorrelationData = b"\x00\x01correlated"
    command = encode(Command.carrying(PointArgs(), "five"), "json")
    async with (
        measuring(resting) as (listener, _, _),
        aiomqtt.Client(
            resting.host, resting.port, protocol=aiomqtt.ProtocolVersion.V5
        ) as client,
    ):
        await client.subscribe(f"elsewhere/{resting.arm}", qos=1)
        topic = topics.command_topic(resting.arm, "point")
        await client.publish(topic, command, qos=1, properties=properties)
        async with asyncio.timeout(PATIENCE_S):
            message = await anext(aiter(client.messages))
    assert message.properties is not None
    assert message.properties.CorrelationData == b"\x00\x01correlated"
    assert message.properties.ContentType == "application/msgpack"
    assert isinstance(message.payload, bytes)
    answer = decode(Reply, message.payload)
    assert (answer.request, answer.ok) == ("five", True)
    assert listener.replies == {}  # not there as well
