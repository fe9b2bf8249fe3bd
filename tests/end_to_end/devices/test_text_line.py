"""Seven joints and the button on a board that prints lines, some of them broken."""

import numpy as np
import pytest

from tests.end_to_end.arm_matrices import MatrixArm
from tests.end_to_end.measuring import measuring
from tests.end_to_end.workbench import REST, SPHERE, Workbench

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


def write_daemon(bench: Workbench) -> None:
    bench.write_daemon(capture="tracking_rate_hz = 100.0")
    path = bench.folder / "daemon.toml"
    text = path.read_text("utf-8")
    board = f'driver = "latch-board"\nport = "{bench.pty}"'
    assert board in text
    joints = ",".join(["{joint}"] * 7)
    arm = bench.arm_file.read_text("utf-8")
    counts = [
        int(row.partition("=")[2])
        for row in arm.splitlines()
        if row.startswith("counts_per_turn")
    ]
    keys = READ_BY.format(pty=bench.pty, joints=joints, counts=counts)
    path.write_text(text.replace(board, keys), "utf-8")


async def test_points_of_a_printing_board_are_where_the_ball_was(
    bench: Workbench,
) -> None:
    write_daemon(bench)
    rest = '[[motion]]\nkind = "rest"\nduration_s = 3.0'
    bench.write_simulator(
        rest, SPHERE.format(points=4), REST, board=BOARD, faults=FAULTS
    )
    async with measuring(bench) as (listener, _, _):
        await listener.n_points(4)
        await listener.event("device.frames_rejected")
    rounding_mm = MatrixArm(bench.arm_file).resolution_mm()
    for point, edge in zip(listener.points, bench.presses(), strict=True):
        # The hand rests while it presses; what is left is the rounding of counts.
        off_mm = np.abs(np.array(point.xyz_mm) - edge["centre_mm"]).max()
        assert off_mm < rounding_mm
        assert point.quality.ok
