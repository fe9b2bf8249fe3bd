"""Two CANopen nodes and their driver."""

import asyncio
from collections.abc import AsyncIterator

import pytest

from tests.drivers.canopen.rig import CanRig
from traverse.drivers.base.delivery_queue import DeliveryQueue


@pytest.fixture(autouse=True)
def quiet_library(caplog: pytest.LogCaptureFixture) -> None:
    """The library logs each abort that the tests provoke."""
    caplog.set_level("CRITICAL", logger="canopen")


@pytest.fixture
async def rig() -> AsyncIterator[CanRig]:
    made = CanRig(DeliveryQueue(asyncio.get_running_loop()))
    yield made
    made.close()
