from collections.abc import AsyncIterator

import pytest

from tests.drivers.canopen.rig import CanRig


@pytest.fixture(autouse=True)
def quiet_library(caplog: pytest.LogCaptureFixture) -> None:
    """The library logs each abort that the tests provoke."""
    caplog.set_level("CRITICAL", logger="canopen")


@pytest.fixture
async def rig() -> AsyncIterator[CanRig]:
    with CanRig() as made:
        yield made
