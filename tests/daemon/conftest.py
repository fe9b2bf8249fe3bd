from collections.abc import AsyncIterator
from pathlib import Path

import pytest

from tests.daemon.arm_harness import ArmBench
from tests.daemon.board_harness import Bench
from tests.daemon.values import arm_model


@pytest.fixture
async def bench(tmp_path: Path) -> AsyncIterator[Bench]:
    """What measures with one board; some modules have another one of this name."""
    bench = Bench(arm_model(tmp_path))
    yield bench
    bench.device.driver.close()


@pytest.fixture
async def arm_bench(tmp_path: Path) -> AsyncIterator[ArmBench]:
    """What measures with two devices and a pedal, all of them up."""
    bench = ArmBench(tmp_path)
    bench.up()
    yield bench
    bench.close()
