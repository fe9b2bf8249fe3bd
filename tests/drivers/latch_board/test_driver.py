import asyncio

import numpy as np
import pytest

from tests.drivers.latch_board import frame_bodies as bodies
from tests.drivers.latch_board.fake_board import CONFIGURE, HELLO, LATCH, START
from tests.protocol.latch_board_frames import framed
from traverse.drivers.base.registry import driver_class
from traverse.drivers.base.values import (
    STATUS_TIME_UNCERTAIN,
    CountSamples,
    DeviceAlarm,
    DeviceCounters,
    DeviceFault,
    DeviceLost,
    DeviceTemperatures,
    DeviceUp,
    StreamStarted,
)
from traverse.drivers.latch_board.driver import LatchBoardDriver
from traverse.testing.deliveries import Deliveries
from traverse.testing.driver_contract import (
    DriverContract,
    KeptEdgeContract,
    LatchContract,
    StreamContract,
    streaming,
)


class TestLatchBoardContract(
    DriverContract, StreamContract, KeptEdgeContract, LatchContract
):
    pass


def test_the_registry_knows_it():
    assert driver_class("latch-board") is LatchBoardDriver
    with pytest.raises(KeyError):
        driver_class("latchboard")


async def test_samples_lost_on_the_line_leave_a_gap_of_their_number(rig):
    with rig.driver:
        deliveries = await streaming(rig)
        rig.emit(5)
        rig.lose(3)
        rig.emit(5)
        await deliveries.until(lambda: len(deliveries.seqs()) >= 10, "10 samples")
    assert deliveries.seqs() == [0, 1, 2, 3, 4, 8, 9, 10, 11, 12]
    faults = [f for f in deliveries.of(DeviceFault) if f.code == "samples_lost"]
    assert sum(fault.count for fault in faults) == 3


async def test_repeated_samples_are_taken_once(rig):
    with rig.driver:
        deliveries = await streaming(rig)
        rig.emit(4)
        rig.repeat_last_samples()
        rig.emit(1)
        await deliveries.until(lambda: 4 in deliveries.seqs(), "the last sample")
    assert deliveries.seqs() == [0, 1, 2, 3, 4]
    assert deliveries.of(DeviceFault) == []


async def test_times_are_uncertain_while_a_clock_that_jumped_is_learned_anew(rig):
    with rig.driver:
        deliveries = await streaming(rig)

        def statuses():
            return [
                int(row[0]) for b in deliveries.of(CountSamples) for row in b.status
            ]

        rig.emit(5)
        await deliveries.until(lambda: len(deliveries.seqs()) >= 5, "5 samples")
        await asyncio.sleep(0.7)  # its first half second is over
        rig.emit(2)
        await deliveries.until(lambda: len(deliveries.seqs()) >= 7, "7 samples")
        assert set(statuses()) == {0}
        rig.board.jump(30.0)
        rig.emit(2)
        await deliveries.until(lambda: len(deliveries.seqs()) >= 9, "samples after it")
        assert statuses()[-1] == STATUS_TIME_UNCERTAIN

        def is_over():
            rig.emit(1)
            return statuses()[-1] == 0

        await deliveries.until(is_over, "its clock is known")
        codes = [fault.code for fault in deliveries.of(DeviceFault)]
        assert codes == ["clock_stepped"]


async def test_who_the_board_is_and_what_it_tells_by_itself(rig):
    with rig.driver:
        deliveries = await streaming(rig)
        rig.board.send(
            bodies.temperatures(5, 2300, -32768),
            bodies.alarm(1, 1, 1, 350),
            bodies.alarm(0xFF, 0, 0x8001, 2),
        )
        await deliveries.until(lambda: len(deliveries.of(DeviceAlarm)) == 2, "alarms")
        await deliveries.until(lambda: deliveries.of(DeviceCounters), "counters")
    identity = deliveries.of(DeviceUp)[0].identity
    assert identity.name == f"latch board {bodies.BOARD_ID.hex()}"
    assert identity.firmware == "1.2.3"
    assert identity.moduli_counts == (1 << 23, 1 << 20)
    assert (identity.inputs, identity.max_rate_hz) == (2, 10_000.0)
    assert deliveries.of(DeviceTemperatures)[0].values_c == (23.0, None)
    first, second = deliveries.of(DeviceAlarm)
    assert (first.channel, first.raised, first.code, first.value) == (1, True, 1, 350)
    assert first.text == "encoder signal weak"
    assert (second.channel, second.raised, second.code) == (None, False, 0x8001)


async def test_requests_are_those_of_the_specification(rig):
    with rig.driver:
        await streaming(rig)
    assert rig.board.heard(HELLO)[0] == bytes((1, 1, 1, 1))
    # All inputs, heartbeat 500 ms, temperatures 2000 ms, 5000 us of debouncing.
    assert rig.board.heard(CONFIGURE)[0].hex(" ") == "02 02 ff f4 01 d0 07 88 13 00 00"
    number = 2 + len(rig.board.heard(LATCH))  # which tie the clocks
    assert rig.board.heard(LATCH)[-1] == bytes((5, number))
    start = bytes((3, number + 1)).hex(" ")
    assert rig.board.heard(START)[0].hex(" ") == f"{start} 20 a1 07 00"  # 500 000 mHz


async def test_the_makers_own_bits_of_status_are_a_warning(rig):
    with rig.driver:
        deliveries = await streaming(rig)
        sample = bytearray(rig.board.samples(1)[0])
        sample[-2:] = 0x80, 0x41  # of two channels, the second with an error
        rig.board.send(bytes(sample))
        await deliveries.until(lambda: deliveries.of(CountSamples), "the sample")
    status = deliveries.of(CountSamples)[0].status
    # A busy machine ties the clock late.
    assert (status & ~np.uint8(STATUS_TIME_UNCERTAIN)).tolist() == [[2, 3]]


async def test_a_refused_rate_does_not_cost_the_connection(rig):
    good = rig.board.answers[START]
    rig.board.answers[START] = lambda body: [bodies.reply(START, body[1], 3, 99_000)]
    with rig.driver:
        deliveries = Deliveries(rig.delivery_queue)
        await deliveries.until(lambda: deliveries.of(DeviceUp), "the device is up")
        rig.driver.request_stream(500.0)
        await deliveries.until(lambda: deliveries.of(DeviceFault), "the refusal")
        rig.board.answers[START] = good
        rig.driver.request_stream(50.0)
        await deliveries.until(lambda: deliveries.of(StreamStarted), "the stream")
    (fault,) = deliveries.of(DeviceFault)
    assert fault.code == "request_refused"
    assert "rate out of range (value 99000)" in fault.text
    assert deliveries.of(DeviceLost) == []


async def test_noise_costs_the_frames_it_touches_and_is_counted(rig):
    with rig.driver:
        deliveries = await streaming(rig)
        first, two, three = (framed(body) for body in rig.board.samples(3))
        spoilt = bytes((two[0],)) + bytes(b ^ 0x10 or 1 for b in two[1:-1]) + b"\0"
        rig.board.send_bytes(b"\x07noise\0" + first + spoilt + three)
        await deliveries.until(lambda: 2 in deliveries.seqs(), "the last sample")
        await deliveries.until(
            lambda: any(
                counters.values.get("frames_rejected") == 2
                for counters in deliveries.of(DeviceCounters)
            ),
            "the counter",
        )
    assert deliveries.seqs() == [0, 2]
    codes = {fault.code for fault in deliveries.of(DeviceFault)}
    assert codes == {"samples_lost", "frames_rejected"}


async def test_samples_of_an_older_stream_are_left_out(rig):
    with rig.driver:
        deliveries = await streaming(rig)
        old = rig.board.samples(3)
        rig.driver.request_stream(100.0)
        await deliveries.until(
            lambda: len(deliveries.of(StreamStarted)) == 2, "second stream"
        )
        rig.board.send(*old)
        rig.emit(2)
        await deliveries.until(lambda: len(deliveries.seqs()) == 2, "samples")
    second = deliveries.of(StreamStarted)[1]
    assert {block.stream for block in deliveries.of(CountSamples)} == {second.stream}
    assert second.rate_hz == 100.0


async def test_a_loss_at_the_end_is_reported_by_the_heartbeat(rig):
    with rig.driver:
        deliveries = await streaming(rig)
        rig.emit(2)
        rig.lose(4)
        await deliveries.until(lambda: deliveries.of(DeviceFault), "the loss")
    (fault,) = deliveries.of(DeviceFault)
    assert (fault.code, fault.count) == ("samples_lost", 4)
