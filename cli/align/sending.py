"""An alignment sent to the daemon: the command `align`."""

import asyncio
from collections.abc import Mapping
from typing import Any

from traverse.client.arm import Arm
from traverse.client.mqtt.address import BrokerAddress
from traverse.lab.alignment.files import align_args
from traverse.protocol.messages import AlignArgs

PATIENCE_S = 3.0


def send_alignment(values: Mapping[str, Any], arm: str, broker: BrokerAddress) -> None:
    """Have the daemon use an alignment from now on.

    Raises:
        ClientError: Daemon or broker cannot be reached, or it refused.
    """
    asyncio.run(_send(align_args(values), broker, arm))


async def _send(args: AlignArgs, broker: BrokerAddress, arm: str) -> None:
    async with Arm(arm, broker, connect_timeout_s=PATIENCE_S) as there:
        await there.execute(args)
