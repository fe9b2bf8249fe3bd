"""Base on one board, wrist on another, the button on a third: still one arm."""

import numpy as np
import pytest

from tests.end_to_end.agreement import assert_where_the_ball_was
from tests.end_to_end.measuring import measuring
from tests.end_to_end.workbench import REST, SPHERE, SWEEP, Workbench, rest
from traverse.protocol.messages import PointArgs, QualityFlag

pytestmark = pytest.mark.needs("mosquitto")

BOARDS = """\
inputs = ["switch"]
clock_error_ppm = 60.0
[[device]]
id = "wrist"
port = "wrist.pty"
inputs = []
clock_error_ppm = -120.0
first_ticks = 4292967296
[[device]]
id = "handle"
port = "handle.pty"
inputs = ["button"]
clock_error_ppm = 30.0
"""
DEVICES = """
[[device]]
id = "wrist"
driver = "latch-board"
port = "{folder}/wrist.pty"
[[device]]
id = "handle"
driver = "latch-board"
port = "{folder}/handle.pty"
"""


@pytest.fixture
def boards(bench: Workbench) -> Workbench:
    """J1 to J3 on the base, J4 to J7 on the wrist, the button on the handle."""
    for channel in range(3, 7):
        bench.change("arm.toml", f'"base/{channel}"', f'"wrist/{channel - 3}"')
    bench.write_daemon(
        capture="tracking_rate_hz = 500.0",
        source="handle",
        devices=DEVICES.format(folder=bench.folder),
    )
    return bench


async def test_points_of_a_button_on_a_third_board_are_where_the_ball_was(
    boards: Workbench,
) -> None:
    boards.write_simulator(rest(1.0), SPHERE.format(points=6), REST, board=BOARDS)
    async with measuring(boards) as (listener, _, _):
        await listener.n_points(6)
        reply = await listener.command(PointArgs())
        assert reply.ok, reply
        await listener.n_points(7)
        assert listener.healths[-1].skew_mm is not None
    truth = boards.presses()
    points = listener.points[:6]
    assert [e["device"] for e in truth] == ["handle"] * 6
    assert [p.seq for p in listener.points] == list(range(7))
    assert {p.trigger for p in points} == {"button"}
    assert_where_the_ball_was(boards, points, truth, 2.0)
    assert {point.quality.flags for point in points} == {("interpolated",)}
    assert listener.points[6].trigger == "command"


async def test_a_scan_over_two_boards_stays_on_the_ball(boards: Workbench) -> None:
    boards.write_simulator(SWEEP, board=BOARDS)
    async with measuring(boards) as (listener, _, _):
        scan = await listener.start_scan(500.0)
        await listener.scan_points(scan, 900)
        blocks = await listener.stop_scan(scan)
    xyz_mm = np.concatenate([b.xyz_mm for b in blocks if len(b.xyz_mm)])
    off_mm = np.linalg.norm(xyz_mm - [700.0, 100.0, 120.0], axis=1) - 53.8
    swept_mm = off_mm[np.flatnonzero(np.abs(off_mm) < 0.5)[0] + 20 :]
    assert len(swept_mm) > 500
    # 200 mm/s, and two clocks of 180 ppm apart that the host does not know yet.
    assert np.median(np.abs(swept_mm)) < 0.1
    assert np.percentile(np.abs(swept_mm), 90) < 0.25  # on a busy machine
    seq = np.concatenate([b.seq + np.arange(len(b.dtime_ns)) for b in blocks])
    assert (np.diff(seq) == 1).all()
    quality = np.concatenate([b.quality for b in blocks])
    remarks = QualityFlag.INTERPOLATED | QualityFlag.SKEW
    assert (quality & QualityFlag.INTERPOLATED != 0).mean() > 0.95
    assert (quality & ~np.uint32(remarks) == 0).mean() > 0.95  # a busy machine is late
