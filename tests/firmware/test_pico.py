import struct

import numpy as np
import pytest

from tests.firmware.emulated import (
    COUNTS_PER_TURN,
    assert_the_kind_is_read,
    assert_the_tester_passes,
    assert_thermometers_are_read,
    each_kind,
    pressed,
)
from tests.firmware.pico import PACKAGES, PicoBoard, pico_firmware
from traverse.drivers.base.values import STATUS_ERROR, STATUS_LATE

pytestmark = [pytest.mark.needs("arm", "node"), pytest.mark.slow]

LATE_CYCLES = 10 * 125  # LATE_TICKS of firmware/ports/rp2040/main.c


@pytest.fixture(autouse=True)
def _packages(pytestconfig):
    if not (PACKAGES / "rp2040js").is_dir():
        required = "node" in pytestconfig.getoption("--required").split()
        (pytest.fail if required else pytest.skip)("needs `make node` once")


def test_the_tester_passes_it(tmp_path):
    firmware = pico_firmware("FRONT_END=SSI")
    with PicoBoard(tmp_path / "port", firmware, "--encoders", "ssi") as board:
        assert_the_tester_passes(board, tmp_path)


async def test_a_press_has_the_counts_of_its_first_contact(tmp_path):
    options = ("--counts-per-turn", str(COUNTS_PER_TURN))
    with PicoBoard(tmp_path / "port", pico_firmware(), *options) as board:
        board.do("count 1 5000", "turn 2 -3000", "turn 6 3000")
        latches, presses = await pressed(board, 4, 100.0)
    for latch, press in zip(latches, presses, strict=True):
        status = np.array(latch.status)
        assert not (status & (STATUS_ERROR | STATUS_LATE)).any()
        assert press.mark_cycles < LATE_CYCLES
        assert latch.counts[1] == 5000
        assert (abs(np.subtract(latch.counts, press.counts)) <= 1).all()


@each_kind
async def test_encoders_of_each_kind(tmp_path, kind):
    firmware = pico_firmware(*f"FRONT_END={kind.settings}".split())
    options = ("--encoders", kind.model, "--bits", str(kind.bits))
    with PicoBoard(tmp_path / "port", firmware, *options) as board:
        await assert_the_kind_is_read(board, kind, 50, LATE_CYCLES)


async def test_thermometers_on_wires_of_their_own(tmp_path):
    firmware = pico_firmware("FRONT_END=SSI", "THERMOMETERS=3")
    with PicoBoard(tmp_path / "port", firmware, "--encoders", "ssi") as board:
        await assert_thermometers_are_read(board, 100.0)


def test_the_image_begins_with_a_boot_stage_that_the_rom_accepts():
    # CRC-32/MPEG-2, divided bit by bit here.
    stage = pico_firmware().read_bytes()[:256]
    rest = int.from_bytes(stage[:252], "big") << 32
    rest ^= 0xFFFFFFFF << (252 * 8)
    for bit in range(252 * 8 + 31, 31, -1):
        if rest >> bit & 1:
            rest ^= 0x104C11DB7 << (bit - 32)
    assert struct.unpack("<I", stage[252:]) == (rest,)
