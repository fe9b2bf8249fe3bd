"""What connects from outside over MQTT: the Python client of an arm."""

from clients.address import BrokerAddress
from clients.arm import Arm
from clients.blocking import BlockingArm
from clients.counters import Counters
from clients.errors import (
    BrokerUnreachableError,
    ClientError,
    CommandRefused,
    NoAnswerError,
)
from clients.following import Lost
from clients.results import HeldSession, Resent, ResentScan, StartedScan

__all__ = [
    "Arm",
    "BlockingArm",
    "BrokerAddress",
    "BrokerUnreachableError",
    "ClientError",
    "CommandRefused",
    "Counters",
    "HeldSession",
    "Lost",
    "NoAnswerError",
    "Resent",
    "ResentScan",
    "StartedScan",
]
