"""Sets of positions by SYNC.

The schedule of SYNCs, sent or received.
"""

import struct

from hypothesis import given, settings
from hypothesis import strategies as st

from traverse.drivers.base.values import (
    STATUS_ERROR,
    STATUS_LATE,
    STATUS_MISSING,
    CountSamples,
)
from traverse.drivers.canopen.sync_cycles import SyncCycleAssembler
from traverse.drivers.canopen.sync_source import HostSchedule, ObservedSchedule

NODES = (3, 7, 11)
TURN = 1 << 20
LATE_NS = 100_000


class Deliveries:
    def __init__(
        self, moduli: tuple[int, ...] = (TURN,) * 3, *, stamped: bool = True
    ) -> None:
        self.blocks: list[CountSamples] = []
        self.cycles = SyncCycleAssembler(
            "arm",
            NODES,
            moduli,
            (1, 2, 3),
            self.blocks.append,
            late_ns=LATE_NS,
            stamped=stamped,
        )
        self.cycles.restart(1)

    def answer(self, node: int, count: int) -> None:
        assert self.cycles.take(0x180 + node, count.to_bytes(4, "little"))

    def rows(self) -> list[tuple[int, list[int], list[int]]]:
        self.cycles.flush(10**9, at_once=True)
        return [
            (int(seq), counts.tolist(), status.tolist())
            for block in self.blocks
            for seq, counts, status in zip(
                block.seq, block.counts, block.status, strict=True
            )
        ]


def test_a_sync_of_an_adapter_was_there_before_the_first_answer() -> None:
    deliveries = Deliveries(stamped=False)
    cycles = deliveries.cycles
    for sync_ns, first_ns in ((10_000, 3_000), (20_000, 7_000), (30_000, 4_000)):
        cycles.sync(sync_ns)
        for late_ns, node in enumerate(NODES):
            answered_ns = sync_ns + first_ns + 500 * late_ns
            assert cycles.take(0x180 + node, bytes(4), answered_ns)
    cycles.flush(10**9, at_once=True)
    cycles.sync(40_000)
    for node in NODES:
        assert cycles.take(0x180 + node, bytes(4), 42_000)
    cycles.flush(2 * 10**9, at_once=True)
    assert [block.time_bound_ns for block in deliveries.blocks] == [7_000, 2_000]


def test_a_late_answer_to_an_earlier_sync_does_not_bound_the_next_one() -> None:
    deliveries = Deliveries(stamped=False)
    cycles = deliveries.cycles
    cycles.sync(10_000)
    cycles.sync(20_000)  # nobody has answered the first one yet
    for answered_ns in (21_000, 28_000):  # to the first one, then to the second
        for node in NODES:
            assert cycles.take(0x180 + node, bytes(4), answered_ns)
    cycles.flush(10**9, at_once=True)
    assert [block.time_bound_ns for block in deliveries.blocks] == [8_000]


def test_a_node_that_does_not_answer_keeps_its_last_count() -> None:
    deliveries = Deliveries()
    deliveries.cycles.sync(0)
    deliveries.answer(3, 10)
    deliveries.answer(11, 30)
    deliveries.cycles.sync(1000)
    assert deliveries.rows() == [(0, [10, 2, 30], [0, STATUS_MISSING, 0])]
    assert +deliveries.cycles.missing == {1: 1}
    assert deliveries.cycles.lost == 0


def test_a_sync_that_nobody_answers_is_a_gap() -> None:
    deliveries = Deliveries()
    for answered in (True, False, True):
        deliveries.cycles.sync(0)
        if answered:
            for node in NODES:
                deliveries.answer(node, 5)
    deliveries.cycles.sync(0)
    assert [row[0] for row in deliveries.rows()] == [0, 2]
    assert deliveries.cycles.lost == 1


def test_an_answer_after_the_next_sync_is_not_taken_for_the_new_one() -> None:
    deliveries = Deliveries()
    deliveries.cycles.sync(0)
    deliveries.answer(3, 10)
    deliveries.answer(7, 20)
    deliveries.cycles.sync(1000)
    deliveries.answer(11, 30)  # of the SYNC before
    for node, count in zip(NODES, (11, 21, 31), strict=True):
        deliveries.answer(node, count)
    assert deliveries.rows() == [
        (0, [10, 20, 3], [0, 0, STATUS_MISSING]),
        (1, [11, 21, 31], [0, 0, 0]),
    ]
    assert deliveries.cycles.late == 1
    assert not deliveries.cycles.duplicates


def test_answers_that_lag_by_several_syncs_are_no_duplicates() -> None:
    deliveries = Deliveries()
    for _ in range(3):
        deliveries.cycles.sync(0)
    for count in (10, 11, 12):
        for node in NODES:
            deliveries.answer(node, count)
    deliveries.cycles.sync(0)
    assert deliveries.rows() == [(2, [12, 12, 12], [0, 0, 0])]
    assert deliveries.cycles.late == 6
    assert not deliveries.cycles.duplicates
    assert deliveries.cycles.lost == 2


def test_what_may_be_of_a_sync_before_is_marked_until_syncs_have_paused() -> None:
    deliveries = Deliveries()
    for k, at_ns in enumerate((0, 1000, 2000, 2000 + LATE_NS)):
        deliveries.cycles.sync(at_ns)
        for node in NODES[k == 0 :]:
            deliveries.answer(node, k)
        pauses = [0, 1000 + LATE_NS, 2000 + LATE_NS, 0]
        assert deliveries.cycles.pause_until_ns == pauses[k]
    assert [row[2] for row in deliveries.rows()] == [
        [STATUS_MISSING, 0, 0],
        [STATUS_LATE, 0, 0],
        [STATUS_LATE, 0, 0],
        [0, 0, 0],
    ]
    assert deliveries.cycles.doubtful == {0: 2}
    assert deliveries.cycles.pauses == 1


def test_a_second_answer_is_a_duplicate_and_marks_what_follows() -> None:
    deliveries = Deliveries()
    deliveries.cycles.sync(0)
    for node in NODES:
        deliveries.answer(node, 5)
    deliveries.answer(7, 6)
    deliveries.cycles.sync(1000)
    for node in NODES:
        deliveries.answer(node, 6)
    late = [0, STATUS_LATE, 0]
    assert deliveries.rows() == [(0, [5, 5, 5], late), (1, [6, 6, 6], late)]
    assert deliveries.cycles.duplicates == {1: 1}


def test_frames_that_were_lost_unread_mark_all_until_syncs_have_paused() -> None:
    deliveries = Deliveries()
    for at_ns in (0, LATE_NS, 2 * LATE_NS):  # at the second, SYNCs may be among them
        deliveries.cycles.sync(at_ns)
        for node in NODES:
            deliveries.answer(node, 5)
        if not at_ns:
            deliveries.cycles.note_lost_frames()
    assert [row[2] for row in deliveries.rows()] == [
        [0] * 3,
        [STATUS_LATE] * 3,
        [0] * 3,
    ]


def test_answers_to_a_sync_that_was_lost_unread_are_no_sign_of_two_nodes() -> None:
    deliveries = Deliveries()
    for at_ns in (0, LATE_NS, 2 * LATE_NS):
        deliveries.cycles.sync(at_ns)
        for node in NODES:
            deliveries.answer(node, 5)
        if not at_ns:
            deliveries.cycles.note_lost_frames()  # the next SYNC is among what is lost
            for node in NODES:
                deliveries.answer(node, 6)
            assert deliveries.cycles.strays == 3
            assert not deliveries.cycles.duplicates
    deliveries.answer(7, 6)  # SYNCs have paused: now it is one
    assert deliveries.cycles.duplicates == {1: 1}


def test_an_answer_after_the_end_of_a_stream_is_not_taken_for_one_of_the_next() -> None:
    deliveries = Deliveries()
    deliveries.cycles.sync(0)
    deliveries.cycles.end(10)
    for node in NODES[:2]:
        deliveries.answer(node, 1)  # its own, in time
    deliveries.cycles.restart(2)
    deliveries.cycles.sync(1000)
    for node in NODES:
        deliveries.answer(node, 2)
    deliveries.cycles.sync(2000)
    assert deliveries.rows() == [(0, [2, 2, 2], [0, 0, STATUS_LATE])]
    assert deliveries.cycles.strays == 0


def test_a_count_beyond_the_range_of_its_encoder_is_an_error() -> None:
    deliveries = Deliveries((16, TURN, 1 << 32))
    deliveries.cycles.sync(0)
    for node, count in zip(NODES, (16, 5, 2**32 - 1), strict=True):
        deliveries.answer(node, count)
    assert deliveries.rows() == [(0, [0, 5, 2**32 - 1], [STATUS_ERROR, 0, 0])]


def test_frames_that_are_no_positions_are_left_to_others() -> None:
    deliveries = Deliveries()
    assert not deliveries.cycles.take(0x703, b"\x05")
    assert not deliveries.cycles.take(0x184, bytes(4))
    assert deliveries.cycles.take(0x183, bytes(3))  # too short
    assert deliveries.cycles.take(0x183, bytes(4))  # before any SYNC
    assert deliveries.cycles.strays == 2
    assert deliveries.rows() == []


EVENTS = st.lists(
    st.one_of(
        st.just("sync"),
        st.tuples(st.sampled_from([0x183, 0x187, 0x18B, 0x185]), st.binary(max_size=8)),
    ),
    max_size=60,
)


@settings(deadline=None)  # a busy computer stops for seconds
@given(EVENTS)
def test_no_sequence_of_frames_invents_or_reorders(events: list[object]) -> None:
    deliveries = Deliveries()
    n_syncs, sent = 0, {3: {1}, 7: {2}, 11: {3}}
    for event in events:
        if isinstance(event, tuple):
            can_id, data = event
            if deliveries.cycles.take(can_id, data) and len(data) >= 4:
                count = struct.unpack_from("<I", data)[0] % TURN
                sent[can_id - 0x180].add(count)
        else:
            deliveries.cycles.sync(1000 * n_syncs)
            n_syncs += 1
    rows = deliveries.rows()
    seqs = [row[0] for row in rows]
    assert seqs == sorted(set(seqs))
    assert all(0 <= seq < n_syncs for seq in seqs)
    for block in deliveries.blocks:
        assert (block.sample_time_ns == 1000 * block.seq).all()
    for _, counts, status in rows:
        assert any(not bits & STATUS_MISSING for bits in status)
        for node, count in zip(NODES, counts, strict=True):
            assert count in sent[node]
    assert deliveries.cycles.lost + len(rows) in (n_syncs, n_syncs - 1)


def test_host_syncs_keep_their_schedule_and_make_up_for_delays() -> None:
    schedule = HostSchedule(1000.0, 0)
    assert schedule.due_ns == 1_000_000
    assert schedule.take(1_050_000) == 1
    assert schedule.due_ns == 2_000_000
    assert schedule.take(4_700_000) == 1  # late: 3 and 4 follow, not too close
    assert schedule.due_ns == 5_500_000
    assert schedule.take(5_500_000) == 1
    assert schedule.due_ns == 6_300_000
    assert schedule.take(106_300_000) == 103  # 4 to 106 with one SYNC
    assert schedule.due_ns == 107_100_000


@settings(deadline=None)  # a busy computer stops for seconds
@given(st.lists(st.integers(1, 4), max_size=50), st.randoms(use_true_random=False))
def test_seen_syncs_are_numbered_by_time(steps: list[int], random: object) -> None:
    seen = ObservedSchedule(1000.0)
    assert seen.take(0) == 1
    number = 0
    for step in steps:
        number += step
        jitter = random.uniform(-200_000, 200_000)  # type: ignore[attr-defined]  # hypothesis' own Random
        assert seen.take(round(number * 1_000_100 + jitter)) == step


def test_seen_syncs_that_come_later_and_later_are_not_taken_for_missing_ones() -> None:
    # The broadcast manager of Linux: each a period, and a delay, after the last.
    seen = ObservedSchedule(1000.0)
    assert {seen.take(k * 1_100_000) for k in range(1000)} == {1}


def test_seen_syncs_of_another_master_are_counted_one_by_one() -> None:
    seen = ObservedSchedule(None)
    assert [seen.take(t) for t in (0, 10**9, 10**9 + 5)] == [1, 1, 1]
