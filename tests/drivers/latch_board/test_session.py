"""Messages of an identified board, judged: edges of another start of the board."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from traverse.drivers.base.values import (
    STATUS_TIME_UNCERTAIN,
    DeviceError,
    LatchedCounts,
)
from traverse.drivers.latch_board.identification import board_identity
from traverse.drivers.latch_board.sequences import EdgeSequencer
from traverse.drivers.latch_board.session import MAX_EARLY, LatchBoardSession
from traverse.drivers.timing.device_clock import DeviceClock
from traverse.protocol.latch_board.messages import (
    Edge,
    Heartbeat,
    Hello,
    Latched,
    SampleBlock,
)

UP_TICKS = 1_000_000  # a second since the board was switched on
RECEIVED_NS = 5_000_000_000
DEBOUNCE_TICKS = 5000


def heartbeat(n_edges: int, back: int = 0) -> Heartbeat:
    return Heartbeat(
        streaming=True,
        inputs=0,
        edges_back=back,
        ticks=UP_TICKS,
        next_sample_seq=0,
        next_edge_seq=n_edges,
        tx_dropped=0,
        rx_rejected=0,
    )


def edge(seq: int, ticks: int) -> Edge:
    return Edge(0, 1, 1, seq, ticks, (10, 20), (0, 0))


@pytest.fixture
def delivered() -> list[LatchedCounts]:
    return []


@pytest.fixture
def faults() -> list[str]:
    return []


@pytest.fixture
def session(delivered, faults) -> LatchBoardSession:
    def put(latch) -> bool:
        delivered.append(latch)
        return True

    return LatchBoardSession(
        "base",
        "port",
        EdgeSequencer(),
        clock=DeviceClock(1_000_000),
        n_channels=2,
        debounce_ns=DEBOUNCE_TICKS * 1000,
        put=put,
        fault=lambda code, *_: faults.append(code),
        counters=Counter(),
    )


@pytest.mark.parametrize("ticks", [0, 3000, UP_TICKS - 100_000])
def test_the_first_press_after_a_restart_is_not_one_of_before(
    session, delivered, ticks
):
    """It may arrive before the heartbeat that says that the stream has stopped."""
    session.take(heartbeat(0), RECEIVED_NS)
    with pytest.raises(DeviceError, match="counts its edges anew") as lost:
        session.take(edge(0, ticks), RECEIVED_NS + 1_000_000)
    assert "restarted" in lost.value.remedy
    assert delivered == []


def test_an_edge_may_be_older_than_a_heartbeat_by_its_debouncing(session, delivered):
    session.take(heartbeat(0), RECEIVED_NS)
    session.take(edge(0, UP_TICKS - DEBOUNCE_TICKS), RECEIVED_NS + 1_000_000)
    assert [latch.token for latch in delivered] == [0]


def test_an_old_edge_that_a_heartbeat_counts_is_taken(session, delivered):
    session.take(heartbeat(1, back=1), RECEIVED_NS)
    session.take(edge(0, 2000), RECEIVED_NS + 1_000_000)
    assert [latch.token for latch in delivered] == [0]


def test_presses_that_wait_long_for_the_boards_clock_are_reported_once(
    session, delivered, faults
):
    """A board without encoders sends an edge again until its clock is known."""
    press = Edge(0, 1, 1, 0, UP_TICKS, (), ())
    session._n_channels = 0
    session.take(heartbeat(1, back=1), RECEIVED_NS)
    for tenths in range(60):
        session.take(press, RECEIVED_NS + tenths * 100_000_000)
        assert faults == (["edges_waiting"] if tenths > 30 else [])
    assert delivered == []
    for number in range(300):
        ticks, late_ns = 7_000_000 + 20_000 * number, 200_000
        beat = replace(heartbeat(1, back=1), ticks=ticks)
        session.take(beat, RECEIVED_NS + (ticks - UP_TICKS) * 1000 + late_ns)
    session.take(press, RECEIVED_NS + 13_000_000_000)
    assert [latch.token for latch in delivered] == [0]
    assert faults == ["edges_waiting"]


@pytest.mark.parametrize("bits", [16, 24])
def test_a_counter_of_fewer_bits_is_told_where_it_wraps(session, bits):
    ticks = (1 << bits) - 25_000 + 10_000 * np.arange(3)
    session._check_order(ticks)
    with pytest.raises(DeviceError, match="not 32 bits wide"):
        session._check_order(ticks[-1:] + 10_000 - (1 << bits))


@pytest.fixture
def known(session) -> int:
    """Read the clock for 10 s, in time; return the ticks of the last read."""
    session.take(heartbeat(0), RECEIVED_NS)
    for number in range(1, 501):
        beat_at(session, UP_TICKS + 20_000 * number)
    return UP_TICKS + 20_000 * 500


def test_an_edge_after_all_reads_may_be_as_old_as_it_is_late(session, delivered, known):
    """The counter may have stood still just then; a later reading denies it."""
    ticks, late_ns = known + 10_000, 2_700_000
    read_ns = received_at_ns(ticks) + DEBOUNCE_TICKS * 1000 + late_ns
    session.take(edge(0, ticks), read_ns)
    assert late_ns - 400_000 < delivered[-1].time_bound_ns <= late_ns

    beat_at(session, ticks + 20_000, n_edges=1)
    session.take(edge(1, ticks + 15_000), read_ns + 20_000_000)
    assert delivered[-1].time_bound_ns < 400_000


def beat_at(session, ticks, late_ns=200_000, n_edges=0):
    beat = replace(heartbeat(n_edges, back=n_edges), ticks=ticks)
    session.take(beat, received_at_ns(ticks) + late_ns)


def received_at_ns(ticks):
    return RECEIVED_NS + (ticks - UP_TICKS) * 1000


def test_debouncing_is_no_doubt_about_the_time_of_a_press(session, delivered, known):
    """The first press after a long time may be read before any later sample."""
    ticks = known + 1000
    session.take(edge(0, ticks), received_at_ns(ticks + DEBOUNCE_TICKS) + 200_000)
    (latch,) = delivered
    assert set(latch.status) == {0}
    assert latch.sample_time_ns == pytest.approx(
        received_at_ns(ticks) + 200_000, abs=50_000
    )


def test_a_press_that_is_stamped_after_its_arrival_is_in_doubt(
    session, delivered, known
):
    """Another counter than that of the samples has stamped it."""
    for seq, ahead in enumerate((-DEBOUNCE_TICKS, 3000)):
        session.take(edge(seq, known + 8000 + ahead), received_at_ns(known + 8000))
    before, after = (set(latch.status) for latch in delivered)
    assert (before, after) == ({0}, {STATUS_TIME_UNCERTAIN})


@pytest.mark.parametrize("has_stood", [False, True])
def test_a_press_that_is_read_late_waits_for_the_clock(
    session, delivered, known, has_stood
):
    ticks = known + 1000
    late_ns = 100_000_000
    press, read_ns = edge(0, ticks), received_at_ns(ticks) + late_ns
    session.take(press, read_ns)
    assert delivered == []  # the frame was late, or the counter has stood still
    for number in range(1, 250):
        next_ticks = ticks + 110_000 + 20_000 * number
        beat_at(session, next_ticks, late_ns if has_stood else 200_000, n_edges=1)
        session.take(press, received_at_ns(next_ticks) + late_ns)
        if delivered:
            break
    (latch,) = delivered
    assert set(latch.status) == {STATUS_TIME_UNCERTAIN if has_stood else 0}
    true_ns = received_at_ns(ticks) + (late_ns if has_stood else 200_000)
    assert latch.sample_time_ns == pytest.approx(true_ns, abs=latch.time_bound_ns)
    assert session.clock.steps == has_stood


def test_samples_wait_for_an_answer_where_the_last_one_holds_no_more(
    session, delivered, known
):
    """One came earlier than any latch can have: the counter has gained time."""
    session.begin_stream(1, 7)
    clock, ticks = session.clock, known + 10_000
    sent_ns = received_at_ns(ticks)
    clock.update(ticks, sent_ns + 300_000, sent_ns)
    early_ns = received_at_ns(ticks + 10_000) - 800_000
    session.take(block_of_one(ticks + 10_000), early_ns)
    assert delivered == []
    assert session.holds
    clock.update(ticks + 11_000, early_ns + 1_000_000, early_ns + 700_000)
    session.release()
    assert delivered[-1].time_bound_ns < 500_000


def block_of_one(ticks: int) -> SampleBlock:
    (seq, status), counts = np.zeros((2, 1), np.uint32), np.zeros((1, 2), np.uint32)
    instants = np.array([ticks], np.uint32)
    bits = status.astype(np.uint8)
    return SampleBlock(7, seq, instants, bits, counts, counts.astype(np.uint8))


def test_a_press_of_before_a_step_is_in_doubt_when_the_clock_is_known_again(
    session, delivered, known
):
    """Its time by the new line is off by the counter's loss."""
    lost_ns = 30_000_000
    for number in range(1, 500):
        beat_at(session, known + 20_000 * number, lost_ns, n_edges=1)
    assert session.clock.steps == 1
    assert not session.clock.is_uncertain
    now = known + 20_000 * 500
    for seq, ticks in enumerate((known + 1000, now - DEBOUNCE_TICKS)):
        session.take(edge(seq, ticks), received_at_ns(now) + lost_ns)
    before, after = delivered
    assert set(before.status) == {STATUS_TIME_UNCERTAIN}
    assert set(after.status) == {0}
    assert before.time_bound_ns >= 1_000_000_000 > after.time_bound_ns


def test_the_time_of_a_press_that_a_board_without_joints_noticed_late_has_no_bound(
    session, delivered, known
):
    """It has no joints whose status could say so."""
    session._n_channels = 0
    lost_ns = 900_000_000
    stopped, now = known + 13_000, known + 20_000 * 500
    for ticks in range(known + 20_000, now, 20_000):
        beat_at(session, ticks, lost_ns, n_edges=3)
    assert session.clock.steps == 1
    began = session.clock._stepped_ticks
    for seq, ticks in enumerate((stopped, began + 10_000, now - DEBOUNCE_TICKS)):
        press = Edge(0, 1, 1, seq, ticks, (), ())
        session.take(press, received_at_ns(now) + lost_ns)
    is_known = [latch.time_bound_ns < 1_000_000_000 for latch in delivered]
    assert is_known == [False, False, True]


def test_a_latch_of_a_counter_that_stands_has_the_time_of_its_request(
    session, delivered, known
):
    """Each answer ties the clock anew, at the same ticks."""
    for late_ns in (40_000_000, 70_000_000, 70_500_000):
        sent_ns = received_at_ns(known) + late_ns
        answer = Latched(1, 0, known, (10, 20), (0, 0))
        session.take_latch(answer, 7, sent_ns, sent_ns + 300_000)
        latch = delivered[-1]
        assert latch.sample_time_ns + latch.time_bound_ns >= sent_ns
        assert latch.sample_time_ns <= sent_ns + 300_000
    assert session.clock.steps == 2


def test_after_a_broken_frame_only_edges_until_its_repetition_are_late(
    session, delivered
):
    """Edges every 5 ms, one of them broken once; the board repeats it after 50 ms."""
    session.take(heartbeat(0), RECEIVED_NS)
    late_ms: dict[int, int] = {}
    for at_ms in range(0, 400, 5):
        now_ns = RECEIVED_NS + at_ms * 1_000_000
        arriving = [at_ms // 5] if at_ms != 50 else []  # number 10 is broken
        if at_ms >= 100 and 10 not in late_ms:
            arriving.insert(0, 10)
        for seq in arriving:
            session.take(edge(seq, UP_TICKS + seq * 5000), now_ns)
        for latch in delivered[len(late_ms) :]:
            late_ms[latch.token] = at_ms - latch.token * 5
    assert [latch.token for latch in delivered] == list(range(80))
    assert {seq for seq, late in late_ms.items() if late} == set(range(10, 20))
    assert max(late_ms.values()) == 50


def test_more_early_edges_than_a_board_repeats_are_not_kept(session, delivered):
    session.take(heartbeat(0), RECEIVED_NS)
    for seq in range(1, MAX_EARLY + 5):
        session.take(edge(seq, UP_TICKS + seq), RECEIVED_NS + seq)
    session.take(edge(0, UP_TICKS), RECEIVED_NS + 100)
    assert [latch.token for latch in delivered] == list(range(MAX_EARLY + 1))
    session.take(edge(MAX_EARLY + 1, UP_TICKS), RECEIVED_NS + 200)
    assert delivered[-1].token == MAX_EARLY + 1


def test_what_is_given_up_is_not_kept(session, delivered, faults):
    """The oldest that is repeated is next, and those after it that are kept."""
    session.take(heartbeat(0), RECEIVED_NS)
    for seq in (2, 5, 6):
        session.take(edge(seq, UP_TICKS), RECEIVED_NS)
    session.take(edge(5, UP_TICKS), RECEIVED_NS + 2_000_000_000)
    assert faults == ["edges_lost"]
    assert [latch.token for latch in delivered] == [5, 6]


@pytest.mark.parametrize(
    ("board_id", "serial"),
    [
        (bytes(11) + b"\7", "000000000000000000000007"),
        (bytes(12), ""),  # never written
        (b"\xff" * 12, ""),
    ],
)
def test_an_empty_board_id_is_no_serial_number(board_id, serial):
    hello = Hello(
        request=1,
        version=(1, 0),
        board_id=board_id,
        firmware=(1, 2, 3),
        n_inputs=0,
        n_temperatures=0,
        tick_rate_hz=1_000_000,
        max_rate_hz=1000.0,
        boot_id=1,
        channels=(),
    )
    assert board_identity(hello).serials == (serial,)
