"""The firmware of an Arduino Mega, as its processor runs it: emulated by libsimavr."""

import numpy as np
import pytest

from tests.firmware.mega import COUNTS_PER_TURN, MegaRig, mega_at, mega_firmware
from tests.running import run_traverse
from traverse.drivers.base.values import STATUS_ERROR, STATUS_LATE, LatchedCounts
from traverse.testing.driver_contract import (
    DriverContract,
    KeptEdgeContract,
    LatchContract,
    StreamContract,
    up,
)

pytestmark = [pytest.mark.needs("compiler", "avr", "simavr"), pytest.mark.slow]

LATE_CYCLES = 50 * 16  # LATE_TICKS of firmware/ports/avr/main.c
QUADRATURE = ("--counts-per-turn", str(COUNTS_PER_TURN))


@pytest.fixture
async def rig(tmp_path):
    with mega_at(tmp_path / "port", mega_firmware(), *QUADRATURE) as board:
        rig = MegaRig(board)
        yield rig
        rig.driver.close()


class TestMegaContract(DriverContract, StreamContract, KeptEdgeContract, LatchContract):
    parts = (1, 7, 40)


def test_the_tester_passes_it(tmp_path):
    with mega_at(tmp_path / "port", mega_firmware(), *QUADRATURE) as board:
        ran = run_traverse(tmp_path, "board", "test", str(board.link))
    assert "fail" not in ran.stdout


async def pressed(board, times):
    """Press the button, with bounces; return what came and what was."""
    rig = MegaRig(board, debounce_us=5000)
    presses = []
    with rig.driver:
        taken = await up(rig)
        for n in range(times):
            board.do(f"bounce 0 {1 - n % 2} 5")
            presses.append(board.last_press())
            await taken.until(
                lambda wanted=n + 1: len(taken.of(LatchedCounts)) == wanted, "the press"
            )
            rig.driver.acknowledge(taken.of(LatchedCounts)[-1].token)
    return taken.of(LatchedCounts), presses


async def test_a_press_has_the_counts_of_its_first_contact(tmp_path):
    with mega_at(tmp_path / "port", mega_firmware(), *QUADRATURE) as board:
        board.do("count 1 5000", "turn 2 -3000", "turn 3 20000", "turn 6 10000")
        latches, presses = await pressed(board, 8)
    for latch, press in zip(latches, presses, strict=True):
        status = np.array(latch.status)
        assert not (status & STATUS_ERROR).any()
        late = press.mark_cycles > LATE_CYCLES
        assert ((status & STATUS_LATE) != 0).all() == late, (latch, press)
        assert latch.counts[1] == 5000
        # At most the ways of 100 us at 20 kHz.
        assert (abs(np.subtract(latch.counts, press.counts)) <= 2).all()
    assert sorted(press.mark_cycles for press in presses)[4] < LATE_CYCLES
