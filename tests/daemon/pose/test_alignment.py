"""Part coordinates, by hand and in messages."""

import numpy as np
import pytest

from tests.daemon.board_harness import BOARD
from tests.daemon.values import count_samples, latch
from traverse.daemon.commands.points import PointCommands
from traverse.daemon.pose.alignment import ActiveAlignment, requested_alignment
from traverse.drivers.base.values import DeviceUp
from traverse.protocol.messages import AlignArgs

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


@pytest.fixture
async def bench(bench):
    bench.take(DeviceUp("base", BOARD, False))
    return bench


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
