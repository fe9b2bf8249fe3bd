"""Seven joints and the button on a board that prints lines, some of them broken."""

import pytest

from tests.end_to_end.agreement import assert_where_the_ball_was
from tests.end_to_end.measuring import measuring
from tests.end_to_end.workbench import REST, SPHERE, SWEEP, Workbench, rest

pytestmark = pytest.mark.needs("mosquitto")

BOARD = 'kind = "text-line"\nbuttons = ["button"]\n'
READ_BY = """\
driver = "text-line"
port = "{pty}"
pattern = "$TRV,{{seq}},{{time}},{joints},{{buttons}}*{{checksum}}"
counts_per_turn = {counts}
checksum = "xor"
max_speed_rad_s = 500.0
"""
FAULTS = """
[[fault]]
kind = "cut"
probability = 0.02
"""
UNREAD = """
[[fault]]
kind = "unread"
channel = 1
probability = 0.05
"""


def write_daemon(bench: Workbench) -> None:
    joints = ",".join(["{joint}"] * 7)
    arm = bench.arm_file.read_text("utf-8")
    counts = [
        int(row.partition("=")[2])
        for row in arm.splitlines()
        if row.startswith("counts_per_turn")
    ]
    bench.write_daemon(
        capture="tracking_rate_hz = 100.0",
        read_by=READ_BY.format(pty=bench.pty, joints=joints, counts=counts),
    )


@pytest.mark.slow
async def test_points_of_a_printing_board_are_where_the_ball_was(
    bench: Workbench,
) -> None:
    write_daemon(bench)
    motions = (rest(3.0), SPHERE.format(points=4), REST)
    bench.write_simulator(*motions, board=BOARD, faults=FAULTS)
    async with measuring(bench) as (listener, _, _):
        await listener.n_points(4)
        await listener.event("device.frames_rejected")
    assert_where_the_ball_was(bench, listener.points, bench.presses())
    # Whole lines are as good as ever; a busy machine may read some too late to know
    # their times.
    flags = {flag for point in listener.points for flag in point.quality.flags}
    assert flags <= {"time_uncertain"}


@pytest.mark.slow
async def test_a_board_that_prints_old_counts_now_and_then_is_in_doubt(
    bench: Workbench,
) -> None:
    write_daemon(bench)
    motions = (rest(3.0), SWEEP, SPHERE.format(points=4), REST)
    bench.write_simulator(*motions, board=BOARD, faults=UNREAD)
    async with measuring(bench, state=None) as (listener, _, _):
        event = await listener.event("condition.single_readings", active=True)
        await listener.n_points(4)
    assert "of J2 (base/1)" in event.text
    assert {"from_ns", "until_ns", "flags", "readings"} <= event.data.keys()
    until_ns = int(event.data["until_ns"])
    later = [point for point in listener.points if point.time_ns > until_ns]
    assert later
    assert all("stale" in point.quality.flags for point in later)
