from collections import Counter

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from traverse.drivers.base.pending_edges import MAX_WAITING, PendingEdges
from traverse.drivers.base.values import CountSamples, PolledSample
from traverse.drivers.microscribe.line import TimedPacket
from traverse.drivers.microscribe.packets import PacketClock, timer_runs
from traverse.drivers.polling.pedals import PedalDebouncer
from traverse.drivers.polling.sampling import SampleBlockBuilder
from traverse.protocol.microscribe.packets import Packet

MS = 1_000_000
REQUEST_NS, REPLY_NS, WIRE_NS = 100_000, 1_450_000, 1_350_000


def heard(
    latch_ns: int, ticks: int, before_ns: int = 0, after_ns: int = 0
) -> TimedPacket:
    """An exchange whose host was busy before and after the latch."""
    begun_ns = latch_ns + REPLY_NS + after_ns
    sent_ns = latch_ns - REQUEST_NS - before_ns
    packet = Packet(0, ticks % 16384, (0,) * 6)
    exchange_ns = begun_ns - sent_ns
    delay_ns = (exchange_ns + WIRE_NS) // 2
    return TimedPacket(packet, sent_ns, begun_ns, begun_ns, delay_ns)


def errors_ns(
    clock: PacketClock, period_ms: float, true_hz: float = 1000.1
) -> np.ndarray:
    """Of times in a stream whose host is busy for some ms in one of ten exchanges."""
    rng = np.random.default_rng(11)
    errors = []
    for k in range(2000):
        latch_ns = 10**12 + round(k * period_ms * MS)
        ticks = int((latch_ns - 10**12) * true_hz * 1e-9 + 15900.3)  # wraps soon
        busy = rng.exponential(4 * MS, 2) * (rng.random(2) < 0.1)
        packet = heard(latch_ns, ticks, *map(int, busy))
        assert not clock.is_old(packet)
        unwrapped, time_ns = clock.time_of(packet)
        assert packet.sent_ns <= time_ns <= packet.begun_ns
        assert unwrapped in (ticks, time_ns)
        errors.append(time_ns - latch_ns)
    return np.array(errors[150:])  # the clock has settled after a second


@pytest.mark.parametrize("period_ms", [10.0, 7.3])
def test_the_timer_bounds_what_a_busy_host_adds(period_ms):
    """Also where requests run in step with it, so that ticks never show their edges."""
    delay_ns = heard(0, 0).delay_ns
    with_timer = errors_ns(PacketClock(1000.0, 16384, delay_ns), period_ms)
    without = errors_ns(PacketClock(0.0, 16384, delay_ns), period_ms)
    # Its edges are known to a tick, and a sample is put into a tick.
    assert np.abs(with_timer).max() < 2.1 * MS
    assert np.percentile(np.abs(with_timer), 99) < 1.1 * MS
    assert np.abs(np.median(with_timer)) < 0.1 * MS
    assert np.abs(without).max() > 5 * MS
    assert np.percentile(np.abs(without), 99) > 2 * MS


@pytest.mark.parametrize("true_hz", [900.0, 995.0, 999.0, 1002.0, 1100.0, 1190.0])
def test_the_rate_of_a_timer_is_learned(true_hz):
    """It bounds the times like a timer of the stated rate, and loses no packet."""
    clock = PacketClock(1000.0, 16384, heard(0, 0).delay_ns)
    found_ns = errors_ns(clock, 7.3, true_hz)
    assert clock.rate_hz == pytest.approx(true_hz, rel=1.1e-3)
    assert clock.steps == 0
    settled_ns = found_ns[len(found_ns) // 2 :]
    assert np.abs(settled_ns).max() < 2.1 * MS
    assert np.percentile(np.abs(settled_ns), 99) < 1.1 * MS
    # An answer to an earlier request is still recognised.
    begin_ns = 10**12 + 2000 * 7_300_000
    ticks = int((begin_ns - 10**12) * true_hz * 1e-9 + 15900.3)
    assert clock.is_old(heard(begin_ns, ticks, -60 * MS, 80 * MS))
    assert not clock.is_old(heard(begin_ns, ticks))


def test_a_first_exchange_that_was_held_back_delays_nothing():
    """One of 0.4 s alone would leave the rate open by 30 % after these 1.5 s."""
    clock = PacketClock(1000.0, 16384, heard(0, 0).delay_ns)
    for k in range(150):
        clock.time_of(heard(10 * MS * k, 11 * k, 0 if k else 400 * MS))
    assert clock.rate_hz == pytest.approx(1100.0, rel=5e-3)
    assert clock.steps == 0


@pytest.mark.parametrize("late_ms", [3, 5, 7, 9, 11, 13])
def test_a_rate_learned_from_a_wrong_answer_is_learned_anew(late_ms):
    """An answer to the request before looks like a slow timer; low bounds creep up."""
    clock = PacketClock(1000.0, 16384, heard(0, 0).delay_ns)
    for k in range(1200):
        latch_ms = 10 * k - (late_ms if k == 40 else 0)
        clock.time_of(heard(10 * MS * k, int(1.1 * latch_ms)))
    assert clock.rate_hz == pytest.approx(1100.0, rel=2e-3)


def test_a_timer_that_jumps_is_learned_anew():
    clock = PacketClock(1000.0, 16384, REPLY_NS)
    for k in range(400):
        ticks = 9 * k + (5000 if k > 200 else 0)
        packet = heard(10 * MS * k, ticks)
        assert not clock.is_old(packet)
        clock.time_of(packet)
    assert clock.steps
    assert clock.rate_hz == pytest.approx(900.0, rel=3e-3)


def test_an_undisturbed_exchange_is_known_to_what_is_not_line():
    packet = heard(5 * MS, 3)
    _, time_ns = PacketClock(0.0, 16384, 0).time_of(packet)
    # 0.2 ms beside the bytes, of which half is taken to be before the latch.
    assert abs(time_ns - 5 * MS) <= 100_000


def test_an_answer_to_something_asked_before_is_recognised():
    clock = PacketClock(1000.0, 16384, REPLY_NS)
    for k in range(5):
        assert not clock.is_old(heard(10 * MS * k, 10 * k))
        clock.time_of(heard(10 * MS * k, 10 * k))
    late = TimedPacket(Packet(0, 50, ()), 80 * MS, 81 * MS, 81 * MS, 0)
    assert clock.is_old(late)
    assert not clock.is_old(heard(80 * MS, 80))


@pytest.mark.parametrize(
    ("rate_hz", "runs"), [(1000.0, True), (999.0, True), (250.0, False), (0.0, False)]
)
def test_a_timer_is_judged_by_how_far_it_went(rate_hz, runs):
    seen = [heard(k * 20 * MS, 16300 + int(0.02 * k * rate_hz)) for k in range(10)]
    assert timer_runs(seen, 1000.0, 16384) is runs
    # The host was suspended: two answers are each taken for that of the next request.
    late = [
        TimedPacket(seen[k].packet, later.sent_ns, later.begun_ns, later.begun_ns, 0)
        for k, later in ((4, seen[5]), (5, seen[6]))
    ]
    assert timer_runs([*seen[:5], *late, *seen[7:]], 1000.0, 16384) is runs


def sample(number: int, buttons: int) -> PolledSample:
    return PolledSample(
        number * 10 * MS, number * 10 * MS, number, buttons, (number,), (0,)
    )


@given(st.lists(st.integers(0, 3), max_size=40))
def test_an_edge_is_what_two_packets_show(levels):
    pedals = PedalDebouncer(0, 7)
    pedals.begin(sample(0, 0))
    edges_seen = []
    for number, buttons in enumerate(levels, start=1):
        edges = pedals.detect_edges(sample(number, buttons))
        edges_seen.extend((e.number, e.down, e.first.ticks) for e in edges)
    expected = []
    for bit in (0, 1):
        settled = 0
        shown = [0, *(level >> bit & 1 for level in levels)]
        for number in range(2, len(shown)):
            if shown[number] == shown[number - 1] != settled:
                settled = shown[number]
                expected.append((bit, bool(settled), number - 1))
    assert sorted(edges_seen) == sorted(expected)


def test_bouncing_is_one_edge():
    pedals = PedalDebouncer(100 * MS, 7)
    pedals.begin(sample(0, 0))
    shown = [1, 1, 0, 0, 1, 1, 1, 1, 1, 1, 1, 1, 0, 0]
    edges = [
        e for n, b in enumerate(shown, 1) for e in pedals.detect_edges(sample(n, b))
    ]
    assert [(e.down, e.first.ticks) for e in edges] == [(True, 1), (False, 13)]


def test_a_packet_that_only_a_pedal_can_have_caused_is_enough():
    pedals = PedalDebouncer(0, 7)
    pedals.begin(sample(0, 0))
    (edge,) = pedals.detect_edges(sample(1, 2), certain=True)
    assert (edge.number, edge.down, edge.first.ticks) == (1, True, 1)
    assert not pedals.unsettled


def test_edges_wait_for_room_and_the_oldest_go_first():
    accepted, room = [], 0

    def put(latch) -> bool:
        if len(accepted) < room:
            accepted.append(latch.token)
            return True
        return False

    counters, faults = Counter(), []
    queue = PendingEdges("ms", put, lambda *fault: faults.append(fault), counters)
    pedals = PedalDebouncer(0, 7)
    pedals.begin(sample(0, 0))
    (edge,) = pedals.detect_edges(sample(1, 1), certain=True)
    for _ in range(MAX_WAITING + 3):
        queue.add(edge.number, edge.down, edge.first)
    queue.hand_over()
    assert not accepted
    room = 5
    queue.hand_over()
    assert accepted == [4, 5, 6, 7, 8]
    assert counters["edges_received"] == 5
    assert not faults
    room = MAX_WAITING
    queue.hand_over()
    assert len(accepted) == MAX_WAITING
    assert not queue
    assert [(code, count) for code, _, _, count in faults] == [("edges_lost", 3)]


def test_samples_are_gathered_into_blocks():
    blocks: list[CountSamples] = []
    block = SampleBlockBuilder("ms", blocks.append)
    block.deliver(1)
    assert not blocks
    block.add(3, sample(1, 0))
    assert not block.is_due(15 * MS)
    block.add(5, sample(2, 1))
    assert block.is_due(20 * MS)
    block.deliver(7)
    (made,) = blocks
    assert (made.stream, made.seq.tolist()) == (7, [3, 5])
    assert made.inputs.tolist() == [0, 1]
    assert made.counts.tolist() == [[1], [2]]
    assert not block.is_due(100 * MS)
