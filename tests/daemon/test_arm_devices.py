"""How long samples of the arm's devices may come together."""

import pytest

from daemon.arm_devices import ArmDevices
from daemon.configuration import CaptureSection
from tests.daemon.measuring_bench import Bench
from tests.daemon.values import arm_model


@pytest.fixture
async def bench(tmp_path):
    bench = Bench(arm_model(tmp_path))
    yield bench
    bench.device.driver.close()


@pytest.mark.parametrize(
    ("settings", "gather_ns"),
    [
        (CaptureSection(), 25_000_000),
        (CaptureSection(live_rate_hz=100.0), 5_000_000),
        (CaptureSection(scan_block_s=0.01), 5_000_000),
        (CaptureSection(scan_block_s=1.0, live_rate_hz=0.5), 25_000_000),
    ],
)
async def test_samples_come_together_as_long_as_no_message_waits_for_them(
    bench, settings, gather_ns
):
    devices = ArmDevices(bench.measuring.model, [bench.device])
    devices.let_gather(settings)
    assert bench.device.crossing.gather_ns == gather_ns
