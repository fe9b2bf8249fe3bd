"""Limits of blocks of samples of the arm's devices."""

from dataclasses import replace

import numpy as np
import pytest

from tests.daemon.board_harness import BOARD
from tests.daemon.values import MODULI, count_samples, latch
from traverse.daemon.acquisition.joint_devices import JointDevices
from traverse.daemon.config.schema import CaptureSection
from traverse.drivers.base.values import DeviceUp, StreamStarted


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


async def test_an_arm_at_rest_wakes_the_loop_less_often(bench):
    """Until it moves or samples are needed; a point's edge wakes it in any case."""
    queue = bench.device.delivery_queue
    still = np.tile(np.array([500, 600, 700], np.uint32)[: len(MODULI)], (10, 1))

    def taken(first, counts):
        bench.take(count_samples(counts, first=first))
        return queue.batch_window_ns

    bench.take(StreamStarted("base", 1, 100.0))
    windows_ns = [taken(first, still) for first in range(0, 400, 10)]
    assert windows_ns[:20] == [52_000_000] * 20
    assert windows_ns[-15:] == [208_000_000] * 15
    assert taken(400, still + 40_000) == 52_000_000
    for first in range(410, 700, 10):
        taken(first, still)
    assert queue.batch_window_ns == 208_000_000
    latched = tuple(map(int, still[0]))
    bench.take(latch(latched, token=1, now_ns=10**12 + 7_000_000_000))
    assert not bench.measurement.points.has_pending.is_set()  # nothing is awaited
    assert taken(700, still) == 208_000_000
    bench.take(StreamStarted("base", 2, 100.0))  # as for a scan
    assert queue.batch_window_ns == 52_000_000
