import uuid
from collections.abc import AsyncIterator

import pytest

from benchmarks.tools.network import Network
from tests.client.virtual_daemon import VirtualDaemon
from tests.mosquitto import Mosquitto


@pytest.fixture
def virtual(mosquitto: Mosquitto) -> VirtualDaemon:
    """A daemon of an arm whose name no other test uses; not yet running."""
    name = f"arm-{uuid.uuid4().hex[:8]}"
    return VirtualDaemon(name, mosquitto.host, mosquitto.port)


@pytest.fixture
def broker(mosquitto: Mosquitto) -> str:
    return f"{mosquitto.host}:{mosquitto.port}"


@pytest.fixture
async def network(mosquitto: Mosquitto) -> AsyncIterator[Network]:
    async with Network(mosquitto.port) as network:
        yield network
