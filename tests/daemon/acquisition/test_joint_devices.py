"""Limits of blocks of samples of the arm's devices."""

from dataclasses import replace

import pytest

from tests.daemon.board_harness import BOARD
from traverse.daemon.acquisition.joint_devices import JointDevices
from traverse.daemon.config.schema import CaptureSection
from traverse.drivers.base.values import DeviceUp


@pytest.mark.parametrize(
    ("settings", "may_wait", "batch_window_ns"),
    [
        (CaptureSection(), False, 52_000_000),
        (CaptureSection(), True, 20_000_000),
        (CaptureSection(live_rate_hz=100.0), False, 10_400_000),
        (CaptureSection(scan_block_s=0.01), True, 10_400_000),
        (CaptureSection(scan_block_s=1.0, live_rate_hz=0.5), False, 52_000_000),
    ],
)
async def test_samples_come_together_as_long_as_nobody_waits_for_them(
    bench, settings, may_wait, batch_window_ns
):
    devices = JointDevices(bench.measurement.model, [bench.device])
    devices.set_batch_window(settings, may_wait=may_wait)
    assert bench.device.delivery_queue.batch_window_ns == batch_window_ns


async def test_an_arm_that_cannot_latch_is_taken_up_sooner(bench):
    assert bench.device.delivery_queue.batch_window_ns == 52_000_000
    bench.take(DeviceUp("base", replace(BOARD, latches=False), False))
    assert bench.device.delivery_queue.batch_window_ns == 20_000_000
