"""Base on one board, wrist on another, the button on a third: still one arm."""

import asyncio

import numpy as np
import pytest

from tests.end_to_end.agreement import assert_where_the_ball_was
from tests.end_to_end.listener import numbers
from tests.end_to_end.measuring import measuring
from tests.end_to_end.workbench import REST, SPHERE, SWEEP, Workbench, rest
from traverse.protocol.messages import PointArgs, QualityFlag, Scan

pytestmark = pytest.mark.needs("mosquitto")
N_SWEPT = 500

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


@pytest.mark.slow
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


@pytest.mark.slow
async def test_a_scan_over_two_boards_stays_on_the_ball(boards: Workbench) -> None:
    # Again and again: a busy machine's daemon is ready late.
    boards.write_simulator(rest(2.0), SWEEP, board=BOARDS, top="repeat = true")
    async with measuring(boards) as (listener, _, _):
        scan = await listener.start_scan(500.0)
        n_points = 1900
        async with asyncio.timeout(60.0):
            await listener.scan_points(scan, n_points)
            while len(sweep_of(listener.scans)) <= N_SWEPT:
                n_points += 500
                await listener.scan_points(scan, n_points)
        blocks = await listener.stop_scan(scan)
    seq = numbers(blocks)
    assert (np.diff(seq) > 0).all()
    assert blocks[-1].lost == (blocks[-1].total or 0) - len(seq)
    quality = np.concatenate([b.quality for b in blocks])
    doubts = QualityFlag.SKEW | QualityFlag.TIME_UNCERTAIN
    swept = sweep_of(blocks)
    swept_mm, is_marked = off_mm(blocks)[swept], quality[swept] & doubts != 0
    # 200 mm/s, and two clocks of 180 ppm apart that the host does not know yet.
    assert is_marked.all() or np.percentile(swept_mm[~is_marked], 90) < 0.25
    assert is_marked.all() or np.median(swept_mm[~is_marked]) < 0.1
    # What is of neither board's instant says so, or what else is wrong with it.
    assert (quality != 0).mean() > 0.95


def off_mm(blocks: list[Scan]) -> np.ndarray:
    """Distances of a scan's points from where the probe touches the ball."""
    xyz_mm = np.concatenate([b.xyz_mm for b in blocks if len(b.xyz_mm)])
    return np.abs(np.linalg.norm(xyz_mm - [700.0, 100.0, 120.0], axis=1) - 53.8)


def sweep_of(blocks: list[Scan]) -> np.ndarray:
    """The longest stay on the ball, from shortly after the touch until it withdraws."""
    touching = np.flatnonzero(off_mm(blocks) < 0.5)
    ends = np.flatnonzero(np.diff(touching) > 250)
    stays = np.split(touching, ends + 1)
    stay = max(stays, key=len)
    return stay[20:-20]
