"""Limits, from a device's delivery to the message.

Part coordinates, by hand and in messages.
"""

import numpy as np
import pytest

from tests.daemon.board_harness import BOARD
from tests.daemon.values import count_samples, latch
from traverse.daemon.commands.points import PointCommands
from traverse.daemon.config.schema import EndStopSection, QualitySection
from traverse.daemon.pose.alignment import ActiveAlignment, requested_alignment
from traverse.drivers.base.values import DeviceUp
from traverse.protocol.messages import AlignArgs

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


QUARTER = ((0.0, -1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))


def setting(**keys):
    return AlignArgs(
        action="set",
        name="jig",
        rotation=QUARTER,
        translation_mm=(10.0, 20.0, 30.0),
        **keys,
    )


def test_a_quarter_turn_about_z_by_hand():
    part = ActiveAlignment()
    assert part.part_mm(np.array([1.0, 2.0, 3.0])) is None
    part.alignment = requested_alignment(setting(scale=2.0))
    assert part.part_mm(np.array([1.0, 2.0, 3.0])) == (6.0, 22.0, 36.0)
    assert requested_alignment(AlignArgs(action="clear")) is None


async def test_points_and_live_poses_have_them_while_it_is_set(bench):
    align = PointCommands(bench.measurement).align
    bench.take(latch((5, 6, 7)))
    assert await align(setting()) == {"aligned": True, "name": "jig"}
    bench.take(latch((5, 6, 7), token=1), count_samples(np.zeros((3, 3))))
    assert (await align(AlignArgs(action="clear")))["aligned"] is False
    bench.take(latch((5, 6, 7), token=2))
    before, with_it, after = bench.points
    assert before.part_xyz_mm is None
    assert after.part_xyz_mm is None
    x, y, z = with_it.xyz_mm
    assert with_it.part_xyz_mm == pytest.approx((10.0 - y, 20.0 + x, 30.0 + z))
    x, y, z = bench.live[-1].xyz_mm
    assert bench.live[-1].part_xyz_mm == pytest.approx((10.0 - y, 20.0 + x, 30.0 + z))
    assert bench.codes().count("capture.alignment") == 2
