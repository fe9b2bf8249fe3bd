"""Edges and latches on request, one at a time."""

import asyncio

import pytest

from tests.drivers.driver_contract import streaming
from tests.drivers.latch_board import frame_bodies as bodies
from tests.drivers.latch_board.fake_board import CONFIGURE, HELLO, LATCH
from tests.drivers.latch_board.rig import board_rig
from tests.drivers.taken import Taken, until
from traverse.drivers.base.delivery_queue import DeliveryQueue
from traverse.drivers.base.values import (
    DeviceFault,
    DeviceTemperatures,
    DeviceUp,
    LatchedCounts,
    StreamStarted,
)
from traverse.drivers.latch_board.driver import LatchBoardDriver, LatchBoardOptions


@pytest.fixture
async def rig(tmp_path):
    with board_rig(tmp_path) as rig:
        yield rig


async def test_a_board_with_inputs_only_tells_its_edges(rig):
    rig.board.counts = ()
    rig.board.answers[HELLO] = lambda body: [bodies.hello(body[1], channels=())]
    with rig.driver:
        taken = Taken(rig.delivery_queue)
        await taken.until(lambda: taken.of(DeviceUp), "the board")
        tokens = [rig.board.press(1), rig.board.press(1, level=0)]
        await taken.until(lambda: len(taken.of(LatchedCounts)) == 2, "its edges")
        rig.driver.acknowledge(tokens[1])
        await until(lambda: not rig.board.edges, "the acknowledgement")
    identity = taken.of(DeviceUp)[0].identity
    assert (identity.moduli_counts, identity.inputs) == ((), 2)
    assert (identity.latches, identity.max_rate_hz) == (False, 0.0)
    latches = taken.of(LatchedCounts)
    assert [latch.token for latch in latches] == tokens
    assert {(latch.counts, latch.status) for latch in latches} == {((), ())}
    # Its time is only in its heartbeat, which is therefore requested more often.
    assert rig.board.heard(CONFIGURE)[0].hex(" ").startswith("02 02 ff 14 00")


async def test_a_request_is_asked_again_and_answered_once(rig):
    late: list[bytes] = []

    def latch(body):
        late.append(body)
        if len(late) == 1:
            return []
        return [p for b in late for p in rig.board.answer_latch(b)]  # both, late

    with rig.driver:
        taken = await streaming(rig)
        rig.board.answers[LATCH] = latch
        token = rig.driver.request_latch()
        await taken.until(lambda: taken.of(LatchedCounts), "the latch")
        rig.emit(1)
        await taken.until(taken.seqs, "a sample after it")
    assert [latch.token for latch in taken.of(LatchedCounts)] == [token]
    assert late[0][1] != late[1][1]  # a number of its own for each try


async def test_too_many_latch_requests_are_refused(rig):
    for _ in range(16):
        rig.driver.request_latch()
    with pytest.raises(Exception, match="16 latch requests wait"):
        rig.driver.request_latch()


async def test_an_edge_that_the_consumer_has_no_room_for_is_repeated(rig):
    delivery_queue = DeliveryQueue(asyncio.get_running_loop(), max_others=8)
    taken = Taken(delivery_queue)
    with LatchBoardDriver(
        "base", LatchBoardOptions(port=str(rig.board.link)), delivery_queue
    ) as driver:
        await taken.until(lambda: taken.of(DeviceUp), "the device is up")
        driver.request_stream(100.0)
        await taken.until(lambda: taken.of(StreamStarted), "the stream")
        while delivery_queue.put(DeviceTemperatures("filler", ())):
            pass
        seq = rig.board.press()
        sent = len(rig.board.requests)
        rig.board.send(rig.board.edges[seq])
        driver.request_latch()  # its request shows that the edge has been read
        await until(lambda: len(rig.board.requests) > sent, "the latch request")
        assert seq in rig.board.edges
        await taken.until(
            lambda: any(e.input == 0 for e in taken.of(LatchedCounts)), "the edge"
        )
    edges = [latch for latch in taken.of(LatchedCounts) if latch.input == 0]
    assert [latch.token for latch in edges] == [seq]


async def test_frames_with_other_channels_never_reach_the_consumer(rig):
    with rig.driver:
        taken = await streaming(rig)
        request = rig.board.stream_request
        rig.board.send(
            bodies.sample(request, 0, 5, (1, 2, 3)), bodies.edge(0, 1, 0, 5, (1,))
        )
        rig.board.samples(1)
        rig.emit(1)
        await taken.until(taken.seqs, "the good sample")
    assert taken.seqs() == [1]
    assert taken.of(LatchedCounts) == []
    assert "channels_changed" in {fault.code for fault in taken.of(DeviceFault)}


async def test_edges_of_the_time_before_the_start_are_counted_and_forgotten(rig):
    for level in (1, 0, 1, 0):
        rig.board.press(0, level=level)
    rig.board.next_edge += 3  # for which the board had no room
    with rig.driver:
        taken = Taken(rig.delivery_queue)
        await taken.until(lambda: taken.of(DeviceFault), "what was forgotten")
        token = rig.board.press()
        await taken.until(lambda: taken.of(LatchedCounts), "an edge of now")
    (fault,) = taken.of(DeviceFault)
    assert (fault.code, fault.count) == ("edges_lost", 7)
    assert fault.text.startswith("7 button or probe edges of the time before this")
    assert [latch.token for latch in taken.of(LatchedCounts)] == [token]
