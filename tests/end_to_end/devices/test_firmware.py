"""The firmware as the board of an arm: a press is the point of its contact.

Compiled for this computer, and as the processor of an Arduino Mega runs it.
"""

import asyncio

import numpy as np
import pytest

from tests.end_to_end.arm_matrices import MatrixArm
from tests.end_to_end.listener import listening
from tests.end_to_end.workbench import Workbench
from tests.firmware.host_rig import HostBoard
from tests.firmware.mega import MegaBoard, mega_firmware
from traverse.testing.waiting import until

pytestmark = pytest.mark.needs("mosquitto", "compiler")

TURNING_COUNTS_S = 90_000
LATE_COUNTS = TURNING_COUNTS_S // 1000  # in a millisecond; a latch takes 30 us
PRESSES_APART_S = 0.1  # a contact that closes again sooner is one that bounces
TURNS = np.array([2**23] * 4 + [2**22] * 3)
POSTURES = (
    (400_000, 5_500_000, 7_300_000, 2_100_000, 70_000, 4_000_000, 300_000),
    (8_388_607, 5_500_001, 0, 1, 4_194_303, 4_100_000, 310_000),
)


def host_board(bench):
    bench.confirm_board(b"host board\0\1".hex())
    return HostBoard(bench.pty, "--first-ticks", str(2**32 - 3_000_000))


def mega_board(bench):
    bench.confirm_board(b"mega2560\0\0\0\1".hex())
    firmware = mega_firmware("FRONT_END=BISS", "WORD_BITS=23")
    return MegaBoard(bench.pty, firmware, "--encoders", "biss", "--bits", "23")


MEGA = pytest.param(
    mega_board, marks=(pytest.mark.needs("avr", "simavr"), pytest.mark.slow)
)


@pytest.mark.parametrize("board_of", [host_board, MEGA])
async def test_each_press_is_a_point_with_the_counts_latched_at_its_contact(
    bench: Workbench, board_of
) -> None:
    bench.write_daemon()
    with board_of(bench) as board:
        async with listening(bench.host, bench.port, bench.arm) as listener:
            with bench.daemon() as daemon:
                await listener.ready("ready")
                for n, counts in enumerate(POSTURES):
                    board.do(*(f"count {k} {count}" for k, count in enumerate(counts)))
                    # The joints turn on before the press is debounced and sent.
                    turns = (f"turn {k} {TURNING_COUNTS_S}" for k in range(7))
                    board.do("input 0 1", *turns)
                    await listener.n_points(n + 1)
                    board.do("input 0 0")
                    await until(lambda n=n: board.next_edge() == 2 * n + 2, "released")
                    await asyncio.sleep(PRESSES_APART_S)
                assert await daemon.stop() == 0
    arm = MatrixArm(bench.arm_file)
    points = listener.points
    # Where a sample was being latched at the contact, the press says that it is late.
    assert any("late" not in point.quality.flags for point in points)
    for point, counts in zip(points, POSTURES, strict=True):
        off = (np.array(point.counts) - counts + TURNS // 2) % TURNS - TURNS // 2
        if "late" in point.quality.flags:
            assert (np.abs(off) <= LATE_COUNTS).all()
            continue
        assert (off == 0).all()
        xyz_mm, _ = arm.pose(counts)
        assert np.abs(np.array(point.xyz_mm) - xyz_mm).max() < 1e-9
