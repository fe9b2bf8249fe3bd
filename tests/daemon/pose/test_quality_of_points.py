"""Limits, from a device's delivery to the message."""

import numpy as np
import pytest

from tests.daemon.board_harness import BOARD
from tests.daemon.values import count_samples, latch
from traverse.daemon.config.schema import EndStopSection, QualitySection
from traverse.drivers.base.values import DeviceUp

TURN = 65536  # of J1, on channel 2


@pytest.fixture
async def bench(bench):
    bench.take(DeviceUp("base", BOARD, False))
    return bench


def limit(bench, **keys):
    stop = EndStopSection(joint="J1", low_rad=0.5, high_rad=2.0)
    section = QualitySection(end_stops=(stop,), **keys)
    bench.measurement.quality.use(section, bench.model)


def counts_of(angle_rad):
    """Counts of the board where J1 shows an angle."""
    return (0, 0, round(angle_rad / (2.0 * np.pi) * TURN))


async def test_a_point_beyond_a_limit_is_published_with_its_flag(bench):
    limit(bench)
    bench.take(latch(counts_of(1.0)), latch(counts_of(1.99), token=1))
    assert [point.quality.flags for point in bench.points] == [(), ("end_stop",)]
    assert [point.quality.ok for point in bench.points] == [True, False]


async def test_a_point_that_is_not_accepted_is_refused_and_uses_up_no_number(bench):
    limit(bench, refuse=("end_stop",))
    for token, angle_rad in enumerate((1.0, 1.99, 1.0)):
        bench.take(latch(counts_of(angle_rad), token=token))
    assert [point.seq for point in bench.points] == [0, 1]
    (refused,) = [e for e in bench.events if e.code == "capture.refused"]
    assert "end_stop" in refused.text
    assert refused.remedy


async def test_live_poses_and_scans_have_the_flag_too(bench):
    limit(bench)
    bench.take(count_samples(np.array([counts_of(1.99)] * 3)))
    assert bench.live[-1].quality.flags == ("end_stop",)
    assert "limit.end_stop" in bench.codes()
