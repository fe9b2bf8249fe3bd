"""An alignment sent to the daemon: the command `align`."""

import asyncio
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from clients.address import BrokerAddress
from clients.arm import Arm
from lab.acceptance.alignment_file import align_args
from protocol.messages import AlignArgs
from traverse.broker_options import broker_address

PATIENCE_S = 3.0


@dataclass(frozen=True, slots=True)
class Destination:
    """To whom.

    Attributes:
        arm: Name of the arm.
        broker: host, host:port or mqtts://host:port.
        username: None without one.
        password_file: None without one.
        ca_file: None takes the system's certificates.
    """

    arm: str
    broker: str
    username: str | None = None
    password_file: Path | None = None
    ca_file: Path | None = None


def send_alignment(values: Mapping[str, Any], to: Destination) -> None:
    """Have the daemon use an alignment from now on.

    Args:
        values: As in alignment.json.
        to: The arm and its broker.

    Raises:
        ValueError: The address is none.
        ClientError: Daemon or broker cannot be reached, or it refused.
    """
    address = broker_address(to.broker, to.username, to.password_file, to.ca_file)
    asyncio.run(_send(align_args(values), address, to.arm))


async def _send(args: AlignArgs, address: BrokerAddress, arm: str) -> None:
    async with Arm(arm, address, patience_s=PATIENCE_S) as there:
        await there.result(args)
