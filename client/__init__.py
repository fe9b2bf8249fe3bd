"""The Python client of an arm, over MQTT."""

from traverse.broker.address import BrokerAddress
from traverse.client.arm import Arm
from traverse.client.blocking import BlockingArm
from traverse.client.errors import (
    BrokerUnreachableError,
    ClientError,
    CommandRefused,
    Counters,
    NoAnswerError,
)
from traverse.client.frames import to_pandas
from traverse.client.points.session_order import Lost
from traverse.client.results import Resent, ResentScan, StartedScan, StoredSession
from traverse.protocol.messages import Point, Scan

__all__: list[str] = [
    "Arm",
    "BlockingArm",
    "BrokerAddress",
    "BrokerUnreachableError",
    "ClientError",
    "CommandRefused",
    "Counters",
    "Lost",
    "NoAnswerError",
    "Point",
    "Resent",
    "ResentScan",
    "Scan",
    "StartedScan",
    "StoredSession",
    "to_pandas",
]
