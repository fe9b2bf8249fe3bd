import asyncio
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.drivers.latch_board import frame_bodies as bodies
from tests.drivers.latch_board.fake_board import CONFIGURE, HELLO, LATCH
from traverse.drivers.base.delivery_queue import DeliveryQueue
from traverse.drivers.base.values import (
    DeviceFault,
    DeviceTemperatures,
    DeviceUp,
    LatchedCounts,
    StreamStarted,
)
from traverse.drivers.latch_board.driver import LatchBoardDriver, LatchBoardOptions
from traverse.drivers.latch_board.sequences import WRAP, EdgeSequencer, StreamSequence
from traverse.testing.deliveries import Deliveries
from traverse.testing.driver_contract import streaming
from traverse.testing.waiting import until


def reference(numbers: list[int]) -> tuple[list[int], int]:
    """Return kept and lost numbers, by a plain loop."""
    kept, last = [], -1
    for number in numbers:
        if number > last:
            kept.append(number)
            last = number
    return kept, last + 1 - len(kept)


@given(
    st.lists(st.integers(0, 60), max_size=60), st.lists(st.integers(0, 100), max_size=6)
)
def test_losses_and_repeats_are_counted_however_the_blocks_are_cut(numbers, cuts):
    places = sorted({0, len(numbers), *(c % (len(numbers) + 1) for c in cuts)})
    sequence, kept, lost, dropped = StreamSequence(), [], 0, 0
    for start, end in pairwise(places):
        block = np.array(numbers[start:end], np.uint32)
        seq, mask, new_lost, new_dropped = sequence.accept(block)
        assert (len(block) if mask is None else int(mask.sum())) == len(seq)
        kept += seq.tolist()
        lost += new_lost
        dropped += new_dropped
    assert (kept, lost) == reference(numbers)
    assert len(kept) + dropped == len(numbers)


def test_numbers_continue_beyond_32_bits():
    sequence = StreamSequence()
    step = 2**20 - 2**8
    reached = 0
    while reached < WRAP - step:
        reached += sequence.reach(reached + step)
    numbers = np.arange(reached, reached + 2 * step, step // 16)
    for start in range(0, len(numbers), 4):
        seq, _, _, dropped = sequence.accept(
            (numbers[start : start + 4] % WRAP).astype(np.uint32)
        )
        assert seq.tolist() == numbers[start : start + 4].tolist()
        assert dropped == 0
    assert numbers[-1] > WRAP


def test_an_impossible_number_is_dropped():
    sequence = StreamSequence()
    seq, mask, lost, dropped = sequence.accept(np.array([0, 2**30, 1], np.uint32))
    assert seq.tolist() == [0, 1]
    assert mask is not None
    assert (lost, dropped) == (0, 1)


def test_a_heartbeat_tells_of_losses_at_the_end():
    sequence = StreamSequence()
    sequence.accept(np.arange(10, dtype=np.uint32))
    assert sequence.reach(13) == 3
    assert sequence.reach(13) == 0
    assert sequence.reach(5) == 0


def test_edges_are_taken_once_and_in_order():
    edges = EdgeSequencer()
    edges.begin_at(7)
    assert edges.classify(8, 0) == ("early", 0)  # 7 was broken on the line
    assert edges.classify(7, 1) == ("next", 0)
    edges.mark_delivered(7)
    assert edges.classify(7, 2) == ("waiting", 0)
    edges.acknowledge(7)
    assert edges.classify(7, 3) == ("acknowledged", 0)
    assert edges.classify(8, 4) == ("next", 0)


def test_an_edge_that_the_board_lost_is_given_up_after_a_second():
    edges = EdgeSequencer(3)
    assert edges.classify(5, 0) == ("early", 0)
    assert edges.classify(5, 900_000_000) == ("early", 0)
    assert edges.classify(5, 1_000_000_000) == ("next", 2)


def test_after_a_loss_the_oldest_edge_that_the_board_repeats_is_next():
    edges = EdgeSequencer(WRAP - 2)
    assert edges.classify(1, 0) == ("early", 0)
    assert edges.classify(0, 1) == ("early", 0)
    assert edges.classify(5, 1_000_000_001) == ("early", 0)  # 0 follows in a moment
    assert edges.classify(0, 1_050_000_000) == ("next", 2)
    edges.mark_delivered(0)
    assert edges.classify(1, 1_050_000_001) == ("next", 0)


def test_an_edge_that_does_not_come_again_holds_nothing_up_for_ever():
    edges = EdgeSequencer(3)
    assert edges.classify(5, 0) == ("early", 0)
    assert edges.classify(9, 1_900_000_000) == ("early", 0)
    assert edges.classify(9, 2_000_000_000) == ("next", 6)


def test_edge_numbers_wrap():
    edges = EdgeSequencer(WRAP - 1)
    assert edges.classify(WRAP - 1, 0) == ("next", 0)
    edges.mark_delivered(WRAP - 1)
    edges.acknowledge(WRAP - 1)
    assert edges.classify(0, 0) == ("next", 0)
    assert edges.classify(WRAP - 1, 0) == ("acknowledged", 0)


def test_nothing_is_taken_before_the_board_says_with_which_edge_to_begin():
    edges = EdgeSequencer()
    assert edges.classify(11, 0) == ("early", 0)  # 10 may have been broken on the line
    edges.begin_at(12 - 2)  # the heartbeat counts 10 and 11, which are still waiting
    assert edges.classify(11, 1) == ("early", 0)
    assert edges.classify(10, 2) == ("next", 0)
    edges.mark_delivered(10)
    assert edges.classify(11, 3) == ("next", 0)


def test_an_acknowledgement_from_before_a_restart_is_ignored():
    edges = EdgeSequencer(0)
    edges.acknowledge(40)  # of the board's former life
    assert edges.take_acknowledgement() is None
    assert edges.classify(0, 0) == ("next", 0)


def test_a_refused_edge_is_taken_when_it_is_repeated():
    edges = EdgeSequencer(3)
    assert edges.classify(3, 0) == ("next", 0)
    edges.mark_delivered(3)
    edges.mark_refused(3)
    edges.acknowledge(3)  # impossible: it was not sent yet
    assert edges.classify(4, 1) == ("early", 0)
    assert edges.classify(3, 2) == ("next", 0)


def test_edges_are_open_until_the_consumer_has_dealt_with_the_last():
    edges = EdgeSequencer(WRAP - 1)
    assert not edges.has_open_edges
    edges.mark_delivered(WRAP - 1)
    edges.mark_delivered(0)
    assert edges.has_open_edges
    edges.acknowledge(WRAP - 1)
    assert edges.has_open_edges
    edges.acknowledge(0)
    assert not edges.has_open_edges
    edges.mark_delivered(1)
    edges.mark_refused(1)
    assert not edges.has_open_edges


def test_the_board_is_told_once_what_is_dealt_with_and_again_when_it_did_not_hear():
    edges = EdgeSequencer(7)
    assert (edges.needs_acknowledgement, edges.take_acknowledgement()) == (False, None)
    edges.mark_delivered(7)
    assert (edges.needs_acknowledgement, edges.take_acknowledgement()) == (True, None)
    edges.acknowledge(7)
    assert (edges.needs_acknowledgement, edges.take_acknowledgement()) == (True, 7)
    assert (edges.needs_acknowledgement, edges.take_acknowledgement()) == (False, None)
    assert edges.classify(7, 0) == ("acknowledged", 0)
    assert (edges.needs_acknowledgement, edges.take_acknowledgement()) == (True, 7)


async def test_a_board_with_inputs_only_tells_its_edges(rig):
    rig.board.counts = ()
    rig.board.answers[HELLO] = lambda body: [bodies.hello(body[1], channels=())]
    with rig.driver:
        deliveries = Deliveries(rig.delivery_queue)
        await deliveries.until(lambda: deliveries.of(DeviceUp), "the board")
        tokens = [rig.board.press(1), rig.board.press(1, level=0)]
        await deliveries.until(
            lambda: len(deliveries.of(LatchedCounts)) == 2, "its edges"
        )
        rig.driver.acknowledge(tokens[1])
        await until(lambda: not rig.board.edges, "the acknowledgement")
    identity = deliveries.of(DeviceUp)[0].identity
    assert (identity.moduli_counts, identity.inputs) == ((), 2)
    assert (identity.latches, identity.max_rate_hz) == (False, 0.0)
    latches = deliveries.of(LatchedCounts)
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
        deliveries = await streaming(rig)
        rig.board.answers[LATCH] = latch
        token = rig.driver.request_latch()
        await deliveries.until(lambda: deliveries.of(LatchedCounts), "the latch")
        rig.emit(1)
        await deliveries.until(deliveries.seqs, "a sample after it")
    assert [latch.token for latch in deliveries.of(LatchedCounts)] == [token]
    assert late[0][1] != late[1][1]  # a number of its own for each try


async def test_too_many_latch_requests_are_refused(rig):
    for _ in range(16):
        rig.driver.request_latch()
    with pytest.raises(Exception, match="16 latch requests wait"):
        rig.driver.request_latch()


async def test_an_edge_that_the_consumer_has_no_room_for_is_repeated(rig):
    delivery_queue = DeliveryQueue(asyncio.get_running_loop(), max_others=8)
    deliveries = Deliveries(delivery_queue)
    with LatchBoardDriver(
        "base", LatchBoardOptions(port=str(rig.board.link)), delivery_queue
    ) as driver:
        await deliveries.until(lambda: deliveries.of(DeviceUp), "the device is up")
        driver.request_stream(100.0)
        await deliveries.until(lambda: deliveries.of(StreamStarted), "the stream")
        while delivery_queue.put(DeviceTemperatures("filler", ())):
            pass
        seq = rig.board.press()
        sent = len(rig.board.requests)
        rig.board.send(rig.board.edges[seq])
        driver.request_latch()  # its request shows that the edge has been read
        await until(lambda: len(rig.board.requests) > sent, "the latch request")
        assert seq in rig.board.edges
        await deliveries.until(
            lambda: any(e.input == 0 for e in deliveries.of(LatchedCounts)), "the edge"
        )
    edges = [latch for latch in deliveries.of(LatchedCounts) if latch.input == 0]
    assert [latch.token for latch in edges] == [seq]


async def test_frames_with_other_channels_never_reach_the_consumer(rig):
    with rig.driver:
        deliveries = await streaming(rig)
        request = rig.board.stream_request
        rig.board.send(
            bodies.sample(request, 0, 5, (1, 2, 3)), bodies.edge(0, 1, 0, 5, (1,))
        )
        rig.board.samples(1)
        rig.emit(1)
        await deliveries.until(deliveries.seqs, "the good sample")
    assert deliveries.seqs() == [1]
    assert deliveries.of(LatchedCounts) == []
    assert "channels_changed" in {fault.code for fault in deliveries.of(DeviceFault)}


async def test_edges_of_the_time_before_the_start_are_counted_and_forgotten(rig):
    for level in (1, 0, 1, 0):
        rig.board.press(0, level=level)
    rig.board.next_edge += 3  # for which the board had no room
    with rig.driver:
        deliveries = Deliveries(rig.delivery_queue)
        await deliveries.until(lambda: deliveries.of(DeviceFault), "what was forgotten")
        token = rig.board.press()
        await deliveries.until(lambda: deliveries.of(LatchedCounts), "an edge of now")
    (fault,) = deliveries.of(DeviceFault)
    assert (fault.code, fault.count) == ("edges_lost", 7)
    assert "forgot 7 button or probe edges of the time before this" in fault.text
    assert [latch.token for latch in deliveries.of(LatchedCounts)] == [token]
