import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from traverse.drivers.base.values import STATUS_MISSING, STATUS_WARNING, CountSamples
from traverse.drivers.polling.channel import (
    ASK_AGAIN_NS,
    DAMAGE_NS,
    IMPLAUSIBLE,
    UNCONFIRMED,
    EncoderReading,
    PolledChannel,
    ReadError,
)
from traverse.drivers.polling.exchange import ExchangeTimer
from traverse.drivers.polling.sampling import (
    BLOCK_NS,
    SampleBlockBuilder,
    SampleSchedule,
    sample_of_readings,
)

TURN = 16384
SPEED_RAD_S = 20.0
MS = 1_000_000
SILENT = ReadError("silent", "does not answer", "check it")
GARBLED = ReadError("garbled", "has wrong check bits", "check it", is_damage=True)
PERIOD_NS = 10 * MS


def channel(count=0, modulus=TURN) -> PolledChannel:
    """One that has been read at `count` at time 0 and 1 ms."""
    made = PolledChannel("encoder 1", modulus, TURN, SPEED_RAD_S)
    assert made.accept(EncoderReading(count, 0), 0) is UNCONFIRMED
    assert made.accept(EncoderReading(count, MS), MS) is None
    return made


def steps_in(ms: float) -> float:
    """Counts that a joint at the limit makes in a time."""
    return SPEED_RAD_S * ms * 1e-3 / math.tau * TURN


@given(st.integers(0, TURN - 1), st.integers(1, 70), st.booleans())
def test_what_a_joint_can_reach_is_believed_across_the_wrap(start, ms, backwards):
    step = int(steps_in(ms)) * (-1 if backwards else 1)
    encoder = channel(start)
    assert (
        encoder.accept(EncoderReading((start + step) % TURN, (1 + ms) * MS), 0) is None
    )
    assert encoder.count == (start + step) % TURN


@given(st.integers(0, TURN - 1), st.integers(1, 40))
def test_what_it_cannot_reach_is_not(start, ms):
    step = int(steps_in(ms + 1)) + 6
    encoder = channel(start)
    far = EncoderReading((start + step) % TURN, (1 + ms) * MS)
    assert encoder.accept(far, 0) is IMPLAUSIBLE
    assert (encoder.count, encoder.misses) == (start, 1)


def test_counts_over_several_turns_may_not_jump_by_whole_turns():
    encoder = channel(5, modulus=TURN << 14)
    assert encoder.accept(EncoderReading(5 + TURN, 2 * MS), 0) is IMPLAUSIBLE
    assert encoder.accept(EncoderReading((TURN << 14) - 5, 3 * MS), 0) is None


def test_three_misses_in_a_row_make_it_missing_and_two_readings_bring_it_back():
    encoder = channel(100)
    for now_ms in (10, 20, 30):
        assert not encoder.missing
        assert encoder.accept(SILENT, now_ms * MS) is SILENT
    assert encoder.missing
    assert not encoder.due(30 * MS + ASK_AGAIN_NS - 1)
    again_ns = 30 * MS + ASK_AGAIN_NS
    assert encoder.due(again_ns)
    assert encoder.accept(EncoderReading(9000, again_ns), again_ns) is UNCONFIRMED
    assert encoder.missing
    assert encoder.due(again_ns + MS)  # at once, not after half a second
    assert encoder.accept(EncoderReading(9001, again_ns + MS), again_ns + MS) is None
    assert not encoder.missing
    assert encoder.count == 9001


@pytest.mark.parametrize("is_checked", [True, False])
@pytest.mark.parametrize("spread", [0, TURN // 4])
def test_readings_elsewhere_are_handed_on_only_if_they_agree(spread, is_checked):
    """It was set anew; spoilt readings differ from each other."""
    encoder = channel()
    encoder.is_checked = is_checked
    for n in range(1, 4):
        answer = EncoderReading(TURN // 2 + (n % 2) * spread, n * 10 * MS)
        is_left_out = n == 1 or spread
        assert encoder.accept(answer, 0) is (IMPLAUSIBLE if is_left_out else None)


def test_readings_that_do_not_agree_do_not_bring_it_back():
    encoder = PolledChannel("encoder 1", TURN, TURN, SPEED_RAD_S)
    counts = [0, 8000, 3000, 12000]
    accepted = [
        encoder.accept(EncoderReading(c, k * MS), k * MS) for k, c in enumerate(counts)
    ]
    assert accepted == [UNCONFIRMED, IMPLAUSIBLE, IMPLAUSIBLE, IMPLAUSIBLE]
    assert encoder.missing
    assert encoder.time_ns is None


def led(n, speed=30.0, acceleration=0.4):
    """Counts of a joint that a hand leads, at `PERIOD_NS`: 1 rad/s and 16 rad/s2."""
    return [round(100 + speed * k + acceleration * k * k / 2.0) for k in range(n)]


def unchecked(counts):
    """An encoder without a check sum that has read these counts."""
    made = PolledChannel("encoder 1", TURN, TURN, SPEED_RAD_S, is_checked=False)
    for number, count in enumerate(counts):
        now_ns = number * PERIOD_NS
        miss = made.accept(EncoderReading(count % TURN, now_ns), now_ns)
        assert miss is (None if number else UNCONFIRMED)
    return made, len(counts) * PERIOD_NS


@given(st.integers(32, 1500), st.booleans())
def test_a_spoilt_count_leaves_the_motion_and_puts_its_neighbours_in_doubt(off, back):
    counts = led(30)
    encoder, now_ns = unchecked(counts[:20])
    spoilt = (counts[20] + (-off if back else off)) % TURN
    assert encoder.accept(EncoderReading(spoilt, now_ns), now_ns) is IMPLAUSIBLE
    assert encoder.count == counts[19]
    now_ns += PERIOD_NS
    assert encoder.accept(EncoderReading(counts[21] % TURN, now_ns), now_ns) is None
    assert encoder.count == counts[21]
    assert encoder.status(now_ns) == STATUS_WARNING
    assert encoder.status(now_ns + DAMAGE_NS) == 0


def test_a_joint_that_is_stopped_suddenly_is_in_no_doubt():
    counts = led(20, speed=60.0, acceleration=0.0)
    encoder, now_ns = unchecked(counts)
    stopped = EncoderReading(counts[-1], now_ns)
    assert encoder.accept(stopped, now_ns) is IMPLAUSIBLE
    for number in range(1, 20):
        at_ns = now_ns + number * PERIOD_NS
        assert encoder.accept(EncoderReading(counts[-1], at_ns), at_ns) is None
        assert encoder.status(at_ns) == 0


@pytest.mark.parametrize("off", [4, -4, 30])
def test_a_joint_that_rests_shows_a_spoilt_count_that_a_hand_could_explain(off):
    encoder, now_ns = unchecked([500, 501, 500, 500, 501, 500])
    assert encoder.accept(EncoderReading(500 + off, now_ns), now_ns) is IMPLAUSIBLE
    now_ns += PERIOD_NS
    assert encoder.accept(EncoderReading(500, now_ns), now_ns) is None
    assert encoder.status(now_ns) == STATUS_WARNING


@pytest.mark.parametrize("seconds", [0.7, 1.0, 3.0])
def test_a_joint_that_begins_and_ends_to_move_is_in_no_doubt(seconds):
    """By 0.9 rad, as smoothly as hands do (Flash and Hogan, 1985)."""
    s = np.clip(np.arange(-20, 120) * PERIOD_NS * 1e-9 / seconds, 0.0, 1.0)
    turned_rad = 0.9 * s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
    encoder, now_ns = unchecked(np.rint(turned_rad * TURN / math.tau).astype(int))
    assert encoder.status(now_ns) == 0


@given(st.floats(-100.0, 100.0), st.floats(-0.4, 0.4))
def test_what_a_hand_does_is_in_no_doubt(speed, acceleration):
    encoder, now_ns = unchecked(led(60, speed, acceleration))
    assert encoder.status(now_ns) == 0


@pytest.mark.parametrize("is_checked", [True, False])
def test_a_reading_with_wrong_check_bits_puts_others_in_doubt(is_checked):
    encoder = PolledChannel("encoder 1", TURN, TURN, SPEED_RAD_S, is_checked=is_checked)
    encoder.accept(SILENT, 0)
    assert encoder.status(0) == 0
    encoder.accept(GARBLED, MS)
    assert encoder.status(MS) == (0 if is_checked else STATUS_WARNING)


def test_a_sample_states_how_far_the_worst_of_its_instants_may_be_off():
    readings = [EncoderReading(7, 100, 0, 300), EncoderReading(8, 900, 0, 200), None]
    assert sample_of_readings(0, readings, [7, 8, 9], 1000).time_bound_ns == 300


@given(
    st.floats(1.0, 5000.0),
    st.lists(st.integers(0, 3_000_000_000), min_size=1, max_size=30),
)
def test_every_sample_is_taken_or_skipped_and_never_before_its_instant(rate_hz, steps):
    begin_ns = 10**12
    schedule = SampleSchedule(rate_hz, begin_ns)
    now_ns, expected = begin_ns, 0
    for step_ns in steps:
        now_ns += step_ns
        if schedule.next_ns > now_ns:
            continue
        number, instant_ns, skipped = schedule.take(now_ns)
        assert number == expected + skipped
        assert instant_ns == pytest.approx(begin_ns + number * 1e9 / rate_hz, abs=1)
        assert now_ns - 1 - 1e9 / rate_hz < instant_ns <= now_ns + 1
        expected = number + 1


def test_a_block_has_the_instants_of_its_readings():
    blocks: list[CountSamples] = []
    block = SampleBlockBuilder("arm", blocks.append)
    block.deliver(1)
    assert not blocks
    readings = [EncoderReading(7, 1_000_300, STATUS_WARNING), None]
    block.add(4, sample_of_readings(1_000_000, readings, [7, 99], 1_000_900))
    assert not block.is_due(1_000_000 + BLOCK_NS - 1)
    assert block.is_due(1_000_000 + BLOCK_NS)
    block.deliver(3)
    block.deliver(3)
    (samples,) = blocks
    assert (samples.device, samples.stream, samples.received_ns) == (
        "arm",
        3,
        1_000_900,
    )
    assert samples.seq.tolist() == [4]
    assert samples.sample_time_ns.tolist() == [1_000_000]
    assert samples.counts.tolist() == [[7, 99]]
    assert samples.status.tolist() == [[STATUS_WARNING, STATUS_MISSING]]
    assert samples.skew_ns is not None
    assert samples.skew_ns.tolist() == [[300, 900]]


def held_back(rate_hz, is_checked):
    """A block with one sample of 1 ms, and where its blocks go."""
    blocks: list[CountSamples] = []
    block = SampleBlockBuilder("arm", blocks.append)
    block.begin(rate_hz, is_checked=is_checked)
    readings = [EncoderReading(7, MS), EncoderReading(8, MS)]
    block.add(0, sample_of_readings(MS, readings, [7, 8], MS))
    return block, blocks, readings


def test_a_sample_without_a_check_sum_takes_over_what_marks_the_next():
    block, blocks, readings = held_back(100.0, is_checked=False)
    assert not block.is_due(12 * MS)
    block.add(1, sample_of_readings(11 * MS, readings, [7, 8], MS), STATUS_WARNING)
    assert block.is_due(12 * MS)
    block.deliver(1)
    block.finish(1)
    assert [samples.seq.tolist() for samples in blocks] == [[0], [1]]
    assert [samples.status.tolist() for samples in blocks] == [
        [[STATUS_WARNING, STATUS_WARNING]],
        [[0, 0]],
    ]


@pytest.mark.parametrize(("rate_hz", "is_checked"), [(100.0, True), (30.0, False)])
def test_no_sample_waits_whose_bytes_are_checked_or_whose_next_is_far(
    rate_hz, is_checked
):
    block, blocks, _ = held_back(rate_hz, is_checked)
    assert block.is_due(11 * MS)
    block.deliver(1)
    assert blocks[0].seq.tolist() == [0]


def test_a_sample_whose_next_does_not_come_waits_no_longer_than_a_while():
    block, blocks, _ = held_back(100.0, is_checked=False)
    assert not block.is_due(15 * MS)
    assert block.is_due(16 * MS)
    block.deliver(1)
    assert blocks[0].seq.tolist() == [0]


def test_a_count_was_taken_between_the_request_and_its_reply():
    timer = ExchangeTimer(byte_ns=100_000)
    assert timer.latch(1_000_000, 3_000_000, 8, 7) == (2_050_000, 250_000)
    # Bytes take no time on a pseudo-terminal, whose exchanges are quicker.
    assert timer.latch(1_000_000, 1_400_000, 8, 7) == (1_200_000, 200_000)
    assert timer.latch(1_000_000, 3_000_000, 8, 7) == (2_000_000, 1_000_000)
