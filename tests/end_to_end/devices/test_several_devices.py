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
    assert_where_the_ball_was(boards, points, truth, 2.0, by_several_clocks=True)
    # A busy machine that has not read a board in time knows that.
    flags = [set(p.quality.flags) - {"time_uncertain", "skew"} for p in points]
    assert flags == [{"interpolated"}] * 6
    assert listener.points[6].trigger == "command"


async def test_a_scan_over_two_boards_stays_on_the_ball(boards: Workbench) -> None:
    # A busy machine's daemon is ready late.
    boards.write_simulator(rest(2.0), SWEEP, board=BOARDS)
    async with measuring(boards) as (listener, _, _):
        scan = await listener.start_scan(500.0)
        await listener.scan_points(scan, 1900)
        blocks = await listener.stop_scan(scan)
    xyz_mm = np.concatenate([b.xyz_mm for b in blocks if len(b.xyz_mm)])
    quality = np.concatenate([b.quality for b in blocks])
    doubts = QualityFlag.SKEW | QualityFlag.TIME_UNCERTAIN
    off_mm = np.abs(np.linalg.norm(xyz_mm - [700.0, 100.0, 120.0], axis=1) - 53.8)
    # From the touch until it withdraws, which a busy machine's scan may still see.
    touching = np.flatnonzero(off_mm < 0.5)
    swept = slice(touching[0] + 20, touching[-1] - 20)
    swept_mm, is_marked = off_mm[swept], quality[swept] & doubts != 0
    assert len(swept_mm) > 500
    # 200 mm/s, and two clocks of 180 ppm apart that the host does not know yet.
    assert np.median(swept_mm) < 0.1
    assert is_marked.all() or np.percentile(swept_mm[~is_marked], 90) < 0.25
    seq = np.concatenate([b.seq + np.arange(len(b.dtime_ns)) for b in blocks])
    assert (np.diff(seq) == 1).all()
    remarks = QualityFlag.INTERPOLATED | doubts
    assert (quality & QualityFlag.INTERPOLATED != 0).mean() > 0.95
    assert (quality & ~np.uint32(remarks) == 0).mean() > 0.95  # a busy machine is late
