"""The firmware of an Arduino Mega, as its processor runs it: emulated by libsimavr."""

import math

import numpy as np
import pytest

from tests.firmware.emulated import (
    COUNTS_PER_TURN,
    ProcessorRig,
    assert_the_tester_passes,
    pressed,
)
from tests.firmware.mega import MegaBoard, mega_firmware
from traverse.drivers.base.values import (
    STATUS_ERROR,
    STATUS_LATE,
    CountSamples,
    DeviceAlarm,
    DeviceUp,
    LatchedCounts,
    StreamStarted,
)
from traverse.testing.driver_contract import (
    DriverContract,
    KeptEdgeContract,
    LatchContract,
    StreamContract,
    up,
)

pytestmark = [pytest.mark.needs("compiler", "avr", "simavr"), pytest.mark.slow]

CYCLES_PER_S = 16_000_000
LATE_CYCLES = 50 * 16  # LATE_TICKS of firmware/ports/avr/main.c
# The mark follows the tick that the firmware compares: both ticks are rounded, and
# the mark's own instructions come between.
MARK_CYCLES = 4 * 16
INDEX_COUNTS = 2  # so wide an index is: within it counts agree
QUADRATURE = ("--counts-per-turn", str(COUNTS_PER_TURN))


@pytest.fixture
async def rig(tmp_path):
    with MegaBoard(tmp_path / "port", mega_firmware(), *QUADRATURE) as board:
        rig = ProcessorRig(board)
        yield rig
        rig.driver.close()


class TestMegaContract(DriverContract, StreamContract, KeptEdgeContract, LatchContract):
    parts = (1, 7, 40)


def test_the_tester_passes_it(tmp_path):
    with MegaBoard(tmp_path / "port", mega_firmware(), *QUADRATURE) as board:
        assert_the_tester_passes(board, tmp_path)


async def test_a_press_has_the_counts_of_its_first_contact(tmp_path):
    with MegaBoard(tmp_path / "port", mega_firmware(), *QUADRATURE) as board:
        board.do("count 1 5000", "turn 2 -3000", "turn 3 20000", "turn 6 10000")
        latches, presses = await pressed(board, 150)
    n_late = 0
    for latch, press in zip(latches, presses, strict=True):
        status = np.array(latch.status)
        assert not (status & STATUS_ERROR).any()
        late = (status & STATUS_LATE) != 0
        # While interrupts are held the capture of a later closure replaces the first.
        if press.mark_cycles > LATE_CYCLES + MARK_CYCLES:
            assert late.all(), (latch, press)
        assert late.all() == late.any()
        assert latch.counts[1] == 5000
        if late.all():
            n_late += 1
            continue
        # The way until the latch at 20 kHz, and a count of rounding.
        way = 1 + math.ceil(press.mark_cycles * 20_000 / CYCLES_PER_S)
        assert (abs(np.subtract(latch.counts, press.counts)) <= way).all()
    assert n_late < len(presses) / 2


# settings of the firmware; the emulator's encoders; bits; what the driver says of
# encoders that are absent, without a magnet, weak, disturbed
KINDS = [
    ("SSI GRAY_CODE=0", "ssi", 19, (8, None, None, None)),
    ("BISS", "biss", 19, (8, 2, 1, 2)),
    ("AS5047", "as5047", 14, (8, 2, None, 2)),
    ("AMT22", "amt22", 14, (8, None, None, 2)),
    ("AS5600", "as5600", 12, (8, 2, 1, None)),
    ("AS5600 I2C_MULTIPLEXER=1", "as5600-multiplexer", 12, (8, 2, 1, None)),
]


@pytest.mark.parametrize(
    ("settings", "kind", "bits", "alarms"), KINDS, ids=[kind for _, kind, *_ in KINDS]
)
async def test_encoders_of_each_kind(tmp_path, settings, kind, bits, alarms):
    firmware = mega_firmware(*f"FRONT_END={settings}".split())
    options = ("--encoders", kind, "--bits", str(bits))
    counts = tuple(n * (2**bits - 1) // 6 for n in range(7))
    with MegaBoard(tmp_path / "port", firmware, *options) as board:
        board.do(*(f"count {n} {count}" for n, count in enumerate(counts)))
        rig = ProcessorRig(board, debounce_us=5000)
        board.do("turn 0 0", "count 0 0")
        with rig.driver:
            taken = await up(rig, 250.0 if kind == "as5600-multiplexer" else 500.0)
            await taken.until(lambda: taken.of(StreamStarted), "the stream")
            board.do("bounce 0 1 3")
            press = board.last_press()
            await taken.until(lambda: taken.of(LatchedCounts), "the press")
            n = int(taken.of(StreamStarted)[0].rate_hz)
            await taken.until(lambda: len(taken.seqs()) > n, "a second of samples")
            board.do(*(f"fail {n} {fault}" for n, fault in enumerate((3, 2, 1, 4), 1)))
            expected = {(n, code) for n, code in enumerate(alarms, 1) if code}
            await taken.until(
                lambda: len(taken.of(DeviceAlarm)) >= len(expected), "alarms"
            )
            lag_ms = board.lag_ms()
    (latch,) = taken.of(LatchedCounts)
    assert latch.counts == counts
    assert {(a.channel, a.code) for a in taken.of(DeviceAlarm) if a.raised} == expected
    late = [(status & STATUS_LATE) != 0 for status in latch.status]
    assert press.mark_cycles < LATE_CYCLES or all(late)
    if kind == "as5600-multiplexer":
        assert late[1:] == [True] * 6  # one after the other
    else:
        assert late == [press.mark_cycles > LATE_CYCLES] * 7
        assert len(set(press.latch_cycles)) == 1  # all by one edge of the clock
    assert lag_ms > 0 or taken.seqs()[:n] == list(range(n)), "samples were lost"


async def test_the_counter_wraps_within_a_stream_and_the_power_comes_back(tmp_path):
    firmware = mega_firmware("FRONT_END=SSI")
    first_ticks = str(2**32 - 3_000_000)  # the wrap comes after 1.5 s
    options = ("--encoders", "ssi", "--first-ticks", first_ticks)
    with MegaBoard(tmp_path / "port", firmware, *options) as board:
        rig = ProcessorRig(board)
        with rig.driver:
            taken = await up(rig, 500.0)
            await taken.until(lambda: len(taken.seqs()) > 1000, "2 s of samples")
            rig.press()
            await taken.until(lambda: taken.of(LatchedCounts), "a press after it")
            board.do("power")
            await taken.until(lambda: len(taken.of(DeviceUp)) == 2, "it is back")
    blocks = taken.of(CountSamples)
    ticks = np.concatenate([block.device_ticks for block in blocks])[:1000]
    seqs = np.array(taken.seqs())[:1000]
    assert (np.diff(ticks) == 4000 * np.diff(seqs)).all()  # the driver unwraps them
    assert ticks[-1] - ticks[0] > 3_000_000
    assert [up.restarted for up in taken.of(DeviceUp)] == [False, True]


async def test_a_minute_of_emulated_time_passes_the_wrap_of_an_idle_board(tmp_path):
    first_ticks = str(2**32 - 60_000_000)
    options = (*QUADRATURE, "--first-ticks", first_ticks)
    with MegaBoard(tmp_path / "port", mega_firmware(), *options) as board:
        rig = ProcessorRig(board)
        board.do("turn 0 0", "forward 60")
        with rig.driver:
            taken = await up(rig)
            token = rig.press()
            await taken.until(lambda: taken.of(LatchedCounts), "the press")
    (latch,) = taken.of(LatchedCounts)
    assert latch.token == token == 0


async def test_the_index_shows_that_counts_were_lost_and_puts_them_right(tmp_path):
    per_turn = "{512,512,512,512,512,512,512}"
    firmware = mega_firmware("INDEX_WIRED=1", f"COUNTS_PER_TURN={per_turn}")
    with MegaBoard(tmp_path / "port", firmware, "--counts-per-turn", "512") as board:
        rig = ProcessorRig(board, debounce_us=5000)
        board.do("turn 0 0", "turn 3 2000")
        with rig.driver:
            taken = await up(rig, 100.0)
            await taken.until(lambda: len(taken.seqs()) > 100, "turns with its index")
            assert taken.of(DeviceAlarm) == []
            board.do("turn 3 90000")  # two counts while interrupts are locked
            await taken.until(lambda: taken.of(DeviceAlarm), "the alarm")
            board.do("turn 3 2000")
            await taken.until(lambda: not taken.of(DeviceAlarm)[-1].raised, "its end")
            board.do("bounce 0 1 3")
            press = board.last_press()
            await taken.until(lambda: taken.of(LatchedCounts), "a press")
    assert {(alarm.channel, alarm.code) for alarm in taken.of(DeviceAlarm)} == {(3, 3)}
    (latch,) = taken.of(LatchedCounts)
    assert abs(latch.counts[3] - press.counts[3]) <= INDEX_COUNTS
    assert latch.status[3] & STATUS_ERROR == 0


async def test_a_button_that_is_held_at_power_up_makes_its_first_edge_when_released(
    tmp_path,
):
    with MegaBoard(tmp_path / "port", mega_firmware(), *QUADRATURE) as board:
        board.do("input 0 1", "power")
        rig = ProcessorRig(board, debounce_us=5000)
        with rig.driver:
            taken = await up(rig)
            board.do("input 0 0")
            await taken.until(lambda: taken.of(LatchedCounts), "the release")
            board.do("input 0 1")
            await taken.until(lambda: len(taken.of(LatchedCounts)) == 2, "a press")
    assert [latch.active for latch in taken.of(LatchedCounts)] == [False, True]
