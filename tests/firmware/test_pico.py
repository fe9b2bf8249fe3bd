"""The firmware of a Raspberry Pi Pico, its processor emulated by rp2040js."""

import struct

import numpy as np
import pytest

from tests.firmware.emulated import (
    COUNTS_PER_TURN,
    ProcessorRig,
    assert_the_tester_passes,
    pressed,
)
from tests.firmware.pico import PACKAGES, PicoBoard, pico_firmware
from traverse.drivers.base.values import (
    STATUS_ERROR,
    STATUS_LATE,
    CountSamples,
    DeviceAlarm,
    DeviceUp,
    LatchedCounts,
    StreamStarted,
)
from traverse.testing.driver_contract import up

pytestmark = [pytest.mark.needs("arm", "node"), pytest.mark.slow]

LATE_CYCLES = 10 * 125  # LATE_TICKS of firmware/ports/rp2040/main.c


@pytest.fixture(autouse=True)
def _packages(pytestconfig):
    """Packages of npm, as `make node` puts them there."""
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


async def test_ssi_encoders_are_latched_by_one_edge_and_an_absent_one_is_named(
    tmp_path,
):
    counts = tuple(n * (2**19 - 1) // 6 for n in range(7))
    with PicoBoard(
        tmp_path / "port", pico_firmware("FRONT_END=SSI"), "--encoders", "ssi"
    ) as board:
        rig = ProcessorRig(board, debounce_us=5000)
        board.do("turn 0 0", *(f"count {n} {count}" for n, count in enumerate(counts)))
        with rig.driver:
            taken = await up(rig, 500.0)
            await taken.until(lambda: taken.of(StreamStarted), "the stream")
            board.do("bounce 0 1 3")
            press = board.last_press()
            await taken.until(lambda: taken.of(LatchedCounts), "the press")
            board.do("fail 4 3")
            await taken.until(lambda: taken.of(DeviceAlarm), "the alarm")
    (latch,) = taken.of(LatchedCounts)
    assert latch.counts == counts
    assert len(set(press.latch_cycles)) == 1
    alarm = taken.of(DeviceAlarm)[0]
    assert (alarm.channel, alarm.code) == (4, 8)
    block = taken.of(CountSamples)[0]
    assert set(np.diff(block.device_ticks)) <= {2000}
    assert taken.of(DeviceUp)[0].identity.max_rate_hz == 1764.0


def test_the_image_begins_with_a_boot_stage_that_the_rom_accepts():
    # CRC-32/MPEG-2, divided bit by bit here.
    stage = pico_firmware().read_bytes()[:256]
    rest = int.from_bytes(stage[:252], "big") << 32
    rest ^= 0xFFFFFFFF << (252 * 8)
    for bit in range(252 * 8 + 31, 31, -1):
        if rest >> bit & 1:
            rest ^= 0x104C11DB7 << (bit - 32)
    assert struct.unpack("<I", stage[252:]) == (rest,)
