"""Points of a replay to a broker, in sessions of their own."""

import uuid
from collections.abc import Sequence

import aiomqtt

from traverse.broker.address import BrokerAddress
from traverse.client.mqtt.connection import ConfiguredClient
from traverse.protocol.encoding import encode
from traverse.protocol.messages import Point
from traverse.protocol.topics import point_topic


async def published(points: Sequence[Point], broker: BrokerAddress) -> int:
    """Publish points; return how many.

    Sessions and ids are new ones: these points must not be taken for the captured
    ones, or leave them out because he has them.

    Raises:
        OSError: the broker cannot be reached.
    """
    sessions: dict[str, str] = {}
    try:
        async with ConfiguredClient(broker) as client:
            for point in points:
                session = sessions.setdefault(
                    point.session, f"replay-{uuid.uuid4().hex}"
                )
                retracts = point.retracts
                own = point.model_copy(
                    update={
                        "session": session,
                        "id": _own_id(point.id, sessions),
                        "retracts": retracts and _own_id(retracts, sessions),
                    }
                )
                await client.publish(point_topic(own.arm), encode(own, "msgpack"), 1)
    except aiomqtt.MqttError as error:
        raise OSError(str(error)) from error
    return len(points)


def _own_id(point_id: str, sessions: dict[str, str]) -> str:
    session, _, number = point_id.rpartition("-")
    return f"{sessions.get(session, session)}-{number}"
