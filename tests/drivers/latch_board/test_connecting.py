"""From the port to a board that is up: faults and restarts."""

import asyncio
import fcntl
import os
import termios
import time

import pytest

from tests.drivers.latch_board import frame_bodies as bodies
from tests.drivers.latch_board.fake_board import CONFIGURE, HELLO, LATCH
from traverse.drivers.base.delivery_queue import DeliveryQueue
from traverse.drivers.base.values import (
    DeviceLost,
    DeviceUp,
    LatchedCounts,
    StreamStarted,
)
from traverse.drivers.latch_board.driver import LatchBoardDriver, LatchBoardOptions
from traverse.testing.deliveries import Deliveries
from traverse.testing.driver_contract import streaming
from traverse.testing.waiting import until


async def told_lost(rig) -> DeviceLost:
    deliveries = Deliveries(rig.delivery_queue)
    with rig.driver:
        await deliveries.until(lambda: deliveries.of(DeviceLost), "the loss")
    return deliveries.of(DeviceLost)[0]


async def test_a_port_in_use_is_reported(rig, monkeypatch):
    monkeypatch.setattr("traverse.drivers.io.serial_port.BUSY_PAUSE_S", 0.01)
    holder = os.open(rig.port, os.O_RDWR | os.O_NOCTTY)
    try:
        fcntl.flock(holder, fcntl.LOCK_EX | fcntl.LOCK_NB)  # as pyserial does it
        lost = await told_lost(rig)
    finally:
        fcntl.ioctl(holder, termios.TIOCNXCL)
        os.close(holder)
    assert "in use by another program" in lost.reason
    assert lost.remedy == "stop that program"


async def test_a_file_that_is_no_port_is_reported(tmp_path):
    path = tmp_path / "plain"
    path.write_text("no port")
    delivery_queue = DeliveryQueue(asyncio.get_running_loop())
    deliveries = Deliveries(delivery_queue)
    with LatchBoardDriver("base", LatchBoardOptions(port=str(path)), delivery_queue):
        await deliveries.until(lambda: deliveries.of(DeviceLost), "the loss")
    assert str(path) in deliveries.of(DeviceLost)[0].reason


async def test_a_board_that_does_not_answer_is_reported(rig, monkeypatch):
    monkeypatch.setattr("traverse.drivers.latch_board.line.ANSWER_S", 0.02)
    rig.board.answers[HELLO] = lambda body: []
    lost = await told_lost(rig)
    assert "does not answer HELLO" in lost.reason
    numbers = [body[1] for body in rig.board.heard(HELLO)]
    assert numbers == list(range(1, len(numbers) + 1))
    assert len(numbers) >= 8


async def test_a_board_of_another_version_is_reported(rig):
    rig.board.answers[HELLO] = lambda body: [bodies.reply(HELLO, body[1], 4, 2)]
    lost = await told_lost(rig)
    assert "protocol version not supported (value 2)" in lost.reason
    assert "firmware" in lost.remedy or "configuration" in lost.remedy


async def test_a_hello_of_another_version_is_reported(rig):
    rig.board.answers[HELLO] = lambda body: [bodies.hello(body[1], major=2)]
    lost = await told_lost(rig)
    assert "speaks version 2" in lost.reason


async def test_a_board_of_which_nothing_can_come_is_refused(rig):
    rig.board.answers[HELLO] = lambda body: [
        bodies.hello(body[1], channels=(), inputs=0)
    ]
    assert "neither channels nor inputs" in (await told_lost(rig)).reason


async def test_a_board_with_impossible_channels_is_refused(rig):
    rig.board.answers[HELLO] = lambda body: [bodies.hello(body[1], channels=((33, 0),))]
    assert "impossible channels" in (await told_lost(rig)).reason


async def test_a_board_whose_counter_stands_is_refused(rig):
    rig.board.answers[HELLO] = lambda body: [bodies.hello(body[1], tick_rate_hz=0)]
    assert "0 Hz" in (await told_lost(rig)).reason


async def test_a_refused_configuration_is_reported(rig):
    rig.board.answers[CONFIGURE] = lambda body: [bodies.reply(CONFIGURE, body[1], 5)]
    lost = await told_lost(rig)
    assert "refused CONFIGURE: value out of range" in lost.reason


async def test_closing_while_connecting_does_not_wait_for_the_board(rig):
    rig.board.answers[HELLO] = lambda body: []
    rig.driver.start()
    await until(lambda: rig.board.heard(HELLO), "the first HELLO")
    await asyncio.to_thread(rig.driver.close)
    # A driver that waits for all its tries would have sent eight requests.
    assert len(rig.board.heard(HELLO)) <= 2
    deliveries = Deliveries(rig.delivery_queue)
    rig.delivery_queue.put(DeviceUp("end", None, False))
    await deliveries.until(lambda: deliveries.of(DeviceUp), "what was delivered")
    assert deliveries.of(DeviceLost) == []  # closing is no loss


async def test_silence_of_the_board_is_a_loss(rig):
    skipped_ns = [0]
    delivery_queue = DeliveryQueue(asyncio.get_running_loop())
    deliveries = Deliveries(delivery_queue)
    with LatchBoardDriver(
        "base",
        LatchBoardOptions(port=str(rig.board.link)),
        delivery_queue,
        monotonic_ns=lambda: time.monotonic_ns() + skipped_ns[0],
    ):
        await deliveries.until(lambda: deliveries.of(DeviceUp), "the device is up")
        rig.board.mute = True
        for request in (HELLO, LATCH):
            rig.board.answers[request] = lambda body: []
        await asyncio.sleep(0)
        skipped_ns[0] = 3_000_000_000
        await deliveries.until(lambda: deliveries.of(DeviceLost), "the loss")
    assert "silent for 2 s" in deliveries.of(DeviceLost)[0].reason


@pytest.mark.parametrize("has_chance", [True, False])
async def test_a_board_that_was_restarted_behind_an_open_port_is_noticed(
    rig, has_chance
):
    rig.board.jump(100.0)  # so long it has been running
    with rig.driver:
        deliveries = await streaming(rig)
        for seq in range(3):
            rig.press()
            await deliveries.until(
                lambda n=seq: len(deliveries.of(LatchedCounts)) > n, "edge"
            )
            rig.driver.acknowledge(seq)
        rig.board.restart(has_chance=has_chance)
        await deliveries.until(lambda: len(deliveries.of(DeviceUp)) == 2, "up again")
        await deliveries.until(
            lambda: len(deliveries.of(StreamStarted)) == 2, "its stream"
        )
        rig.press()
        await deliveries.until(
            lambda: len(deliveries.of(LatchedCounts)) == 4, "a new edge"
        )
    assert "stopped its stream" in deliveries.of(DeviceLost)[0].reason
    assert deliveries.of(DeviceUp)[1].restarted
    assert [latch.token for latch in deliveries.of(LatchedCounts)] == [0, 1, 2, 0]


async def test_a_restart_is_reported_even_if_connecting_fails_at_first(rig):
    good = rig.board.answers[CONFIGURE]
    refusals = []

    def refuse_once(body):
        refusals.append(body)
        return (
            [bodies.reply(CONFIGURE, body[1], 5)] if len(refusals) == 1 else good(body)
        )

    with rig.driver:
        deliveries = await streaming(rig)
        rig.board.answers[CONFIGURE] = refuse_once
        rig.board.restart()
        rig.press()
        await deliveries.until(
            lambda: deliveries.of(LatchedCounts), "the edge after it"
        )
    ups = deliveries.of(DeviceUp)
    assert [up.restarted for up in ups] == [False, True]
    # Its counts are to be read with the knowledge of the restart.
    assert deliveries.all.index(ups[1]) < deliveries.all.index(
        deliveries.of(LatchedCounts)[0]
    )


async def test_a_fault_of_the_driver_itself_reaches_the_consumer(rig, caplog):
    def broken_clock() -> int:
        raise ZeroDivisionError("no time")

    delivery_queue = DeliveryQueue(asyncio.get_running_loop())
    deliveries = Deliveries(delivery_queue)
    driver = LatchBoardDriver(
        "base", LatchBoardOptions(port=str(rig.board.link)), delivery_queue
    )
    driver._now_ns, good = broken_clock, driver._now_ns
    driver._pause = lambda seconds: None
    with driver:
        await deliveries.until(lambda: deliveries.of(DeviceLost), "the loss")
        driver._now_ns = good
        await deliveries.until(lambda: deliveries.of(DeviceUp), "the device")
    assert "no time" in deliveries.of(DeviceLost)[0].reason
    assert "fault in the driver of base" in caplog.text
