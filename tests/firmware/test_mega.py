import math

import numpy as np
import pytest
import serial
from cobs import cobs

from tests.firmware.emulated import (
    COUNTS_PER_TURN,
    ProcessorRig,
    assert_the_kind_is_read,
    assert_the_tester_passes,
    assert_thermometers_are_read,
    each_kind,
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


def test_a_long_burst_at_the_rate_of_the_line_loses_nothing(tmp_path):
    """It takes bytes faster than they come: the command after them is answered."""
    stop = bytes.fromhex("05 04 04 4F 91 00")
    with (
        MegaBoard(tmp_path / "port", mega_firmware(), *QUADRATURE) as board,
        serial.Serial(str(board.link), timeout=20.0) as port,
    ):
        port.write(b"\x55" * 3000 + b"\0" + stop)
        assert stop_is_answered(port)


def stop_is_answered(port):
    for _ in range(100):
        frame = port.read_until(b"\0")
        if frame.endswith(b"\0") and cobs.decode(frame[:-1])[:3] == b"\x82\x04\x04":
            return True
    return False


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


@each_kind
async def test_encoders_of_each_kind(tmp_path, kind):
    firmware = mega_firmware(*f"FRONT_END={kind.settings}".split())
    options = ("--encoders", kind.model, "--bits", str(kind.bits))
    with MegaBoard(tmp_path / "port", firmware, *options) as board:
        await assert_the_kind_is_read(board, kind, 500, LATE_CYCLES)


async def test_thermometers_on_wires_of_their_own(tmp_path):
    firmware = mega_firmware("FRONT_END=SSI", "THERMOMETERS=3")
    with MegaBoard(tmp_path / "port", firmware, "--encoders", "ssi") as board:
        await assert_thermometers_are_read(board, 500.0)


async def test_the_counter_wraps_within_a_stream_and_the_power_comes_back(tmp_path):
    firmware = mega_firmware("FRONT_END=SSI")
    first_ticks = str(2**32 - 3_000_000)  # the wrap comes after 1.5 s
    options = ("--encoders", "ssi", "--first-ticks", first_ticks)
    with MegaBoard(tmp_path / "port", firmware, *options) as board:
        rig = ProcessorRig(board)
        with rig.driver:
            deliveries = await up(rig, 500.0)
            await deliveries.until(
                lambda: len(deliveries.seqs()) > 1000, "2 s of samples"
            )
            rig.press()
            await deliveries.until(
                lambda: deliveries.of(LatchedCounts), "a press after it"
            )
            board.do("power")
            await deliveries.until(
                lambda: len(deliveries.of(DeviceUp)) == 2, "it is back"
            )
    blocks = deliveries.of(CountSamples)
    ticks = np.concatenate([block.device_ticks for block in blocks])[:1000]
    seqs = np.array(deliveries.seqs())[:1000]
    assert (np.diff(ticks) == 4000 * np.diff(seqs)).all()  # the driver unwraps them
    assert ticks[-1] - ticks[0] > 3_000_000
    assert [up.restarted for up in deliveries.of(DeviceUp)] == [False, True]


async def test_a_minute_of_emulated_time_passes_the_wrap_of_an_idle_board(tmp_path):
    first_ticks = str(2**32 - 60_000_000)
    options = (*QUADRATURE, "--first-ticks", first_ticks)
    with MegaBoard(tmp_path / "port", mega_firmware(), *options) as board:
        rig = ProcessorRig(board)
        board.do("turn 0 0", "forward 60")
        with rig.driver:
            deliveries = await up(rig)
            token = rig.press()
            await deliveries.until(lambda: deliveries.of(LatchedCounts), "the press")
    (latch,) = deliveries.of(LatchedCounts)
    assert latch.token == token == 0


async def test_the_index_shows_that_counts_were_lost_and_puts_them_right(tmp_path):
    per_turn = "{512,512,512,512,512,512,512}"
    firmware = mega_firmware("INDEX_WIRED=1", f"COUNTS_PER_TURN={per_turn}")
    with MegaBoard(tmp_path / "port", firmware, "--counts-per-turn", "512") as board:
        rig = ProcessorRig(board, debounce_us=5000)
        board.do("turn 0 0", "turn 3 2000")
        with rig.driver:
            deliveries = await up(rig, 100.0)
            await deliveries.until(
                lambda: len(deliveries.seqs()) > 100, "turns with its index"
            )
            assert deliveries.of(DeviceAlarm) == []
            board.do("turn 3 90000")  # two counts while interrupts are locked
            await deliveries.until(lambda: deliveries.of(DeviceAlarm), "the alarm")
            board.do("turn 3 2000")
            await deliveries.until(
                lambda: not deliveries.of(DeviceAlarm)[-1].raised, "its end"
            )
            board.do("bounce 0 1 3")
            press = board.last_press()
            await deliveries.until(lambda: deliveries.of(LatchedCounts), "a press")
    assert {(alarm.channel, alarm.code) for alarm in deliveries.of(DeviceAlarm)} == {
        (3, 3)
    }
    (latch,) = deliveries.of(LatchedCounts)
    assert abs(latch.counts[3] - press.counts[3]) <= INDEX_COUNTS
    assert latch.status[3] & STATUS_ERROR == 0


async def test_a_button_that_is_held_at_power_up_makes_its_first_edge_when_released(
    tmp_path,
):
    with MegaBoard(tmp_path / "port", mega_firmware(), *QUADRATURE) as board:
        board.do("input 0 1", "power")
        rig = ProcessorRig(board, debounce_us=5000)
        with rig.driver:
            deliveries = await up(rig)
            board.do("input 0 0")
            await deliveries.until(lambda: deliveries.of(LatchedCounts), "the release")
            board.do("input 0 1")
            await deliveries.until(
                lambda: len(deliveries.of(LatchedCounts)) == 2, "a press"
            )
    assert [latch.active for latch in deliveries.of(LatchedCounts)] == [False, True]
