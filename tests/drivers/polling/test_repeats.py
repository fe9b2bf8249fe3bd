"""Readings that repeat the count before, and motions in which none does."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.daemon.values import count_samples
from traverse.drivers.base.values import STATUS_MISSING
from traverse.drivers.polling.repeats import RepeatDetector

TURN = 1 << 16
RAD = 2.0 * np.pi / TURN
START_NS = 10**12


class Board:
    """Reads one joint, whose counts a test gives at every sample."""

    def __init__(self, rate_hz=100.0, per_turn=TURN):
        turns = np.array([per_turn])
        self.detector = RepeatDetector(
            "base", np.array([0]), turns, 2.0 * np.pi / turns
        )
        self.rate_hz, self.per_turn = rate_hz, per_turn

    def read(self, counts, missing=(), rows=7):
        repeats = []
        for first in range(0, len(counts), rows):
            block = count_samples(
                counts[first : first + rows, None] % self.per_turn, first=first
            )
            times_ns = START_NS + np.rint(block.seq * 1e9 / self.rate_hz).astype(int)
            status = np.where(np.isin(block.seq, missing), STATUS_MISSING, 0)
            block = replace(
                block,
                sample_time_ns=times_ns,
                status=status.astype(np.uint8)[:, None],
            )
            repeats += self.detector.add(block)
        return repeats


def led(n=120, step=12):
    """A joint that begins to move, and is then led by equal steps."""
    steps = np.minimum(np.arange(n), step)
    return 65_000 + np.cumsum(steps)  # over a full turn


def test_a_repeated_count_by_hand():
    """Steps of 12 counts, of which one is 0 and the next 24."""
    counts = led()
    counts[60] = counts[59]
    (repeat,) = Board().read(counts)
    assert repeat.n_readings == 1
    assert repeat.off_rad == pytest.approx(12 * RAD)
    assert repeat.since_ns == START_NS + 590_000_000
    assert repeat.until_ns == START_NS + 610_000_000
    assert not repeat.is_clear  # 1.2 mrad in 10 ms: 12 rad/s^2, as of a hand


@pytest.mark.parametrize("rows", [1, 2, 7, 120])
@pytest.mark.parametrize("n_readings", [1, 2, 5, 12])
def test_several_in_a_row_are_one_repeat_however_the_stream_is_cut(n_readings, rows):
    counts = led()
    counts[60 : 60 + n_readings] = counts[59]
    (repeat,) = Board().read(counts, rows=rows)
    assert repeat.n_readings == n_readings
    assert repeat.off_rad == pytest.approx(12 * RAD)


@pytest.mark.parametrize(("step", "is_clear"), [(50, False), (60, True)])
def test_what_no_hand_could_make_is_clear(step, is_clear):
    """60 counts are 5.8 mrad, in 10 ms: 58 rad/s^2."""
    counts = led(step=step)
    counts[90] = counts[89]
    (repeat,) = Board().read(counts)
    assert repeat.is_clear == is_clear


def test_backwards_and_while_the_joint_speeds_up():
    counts = -np.cumsum(np.arange(120) // 4)
    counts[80] = counts[79]
    (repeat,) = Board().read(counts)
    assert repeat.off_rad == pytest.approx(-20 * RAD, rel=0.05)


@pytest.mark.parametrize(
    "steps",
    [
        (12, 12, 0, 12, 12),  # an encoder that renews its count more slowly
        (12, 12, 1, 23, 12),  # not exactly the count before
        (12, 12, 0, 18, 18),  # it goes on otherwise
        (12, 6, 0, 6, 12),  # a joint that pauses
        (12, 12, 0, -24, -12),  # that turns back
        (0, 0, 0, 24, 12),  # that begins to move
        (12, 24, 0, 12, 12),  # that was read late before
        (0, 24, 0, 24, 0),  # every second reading
    ],
)
def test_other_steps_are_no_repeat(steps):
    counts = np.cumsum([*np.minimum(np.arange(60), 12), *steps, *[12] * 20])
    assert Board().read(counts) == []


def test_slow_motion_and_coarse_prints_are_no_repeats():
    """A step of 0 is usual, where the encoder resolves no more."""
    slow = np.rint(np.arange(2000) * 0.9).astype(int)
    assert Board().read(slow) == []
    tenths = np.rint(np.arange(2000) * 0.97) * TURN / 3600
    tenths[::7] += TURN / 3600  # and a digit that flickers
    assert Board().read(np.rint(tenths).astype(int)) == []


def test_around_missing_readings_nothing_can_be_said():
    counts = led()
    counts[60] = counts[59]
    assert Board().read(counts, missing=(58,)) == []
    assert Board().read(counts, missing=(62,)) == []
    assert len(Board().read(counts, missing=(50, 70))) == 1


def test_a_reading_that_came_too_soon_is_no_repeat():
    """A polled encoder is asked twice within a millisecond, and then late."""
    board, counts = Board(), led()
    counts[60] = counts[59]
    blocks = [
        count_samples(counts[i : i + 1, None] % TURN, first=i) for i in range(120)
    ]
    soon = replace(blocks[60], sample_time_ns=blocks[59].sample_time_ns + 1_000_000)
    blocks[60] = soon
    assert [repeat for block in blocks for repeat in board.detector.add(block)] == []


def test_a_new_stream_begins_anew():
    board, counts = Board(), led()
    counts[60] = counts[59]
    board.read(counts[:61])
    rest = count_samples(counts[61:, None] % TURN, first=61, stream=2)
    assert board.detector.add(rest) == []


def test_only_motion_in_which_a_repeat_would_show_counts():
    board = Board()
    board.read(np.zeros(60, int))
    assert board.detector.led_ns(0, 10_000_000) == 0
    board.read(led())
    # Of the last block, of one row.
    assert board.detector.led_ns(0, 10_000_000) == 10_000_000
    # Of a board that prints ten times as often, 1.2 counts a line show nothing.
    assert board.detector.led_ns(0, 1_000_000) == 0


@st.composite
def hand_motions(draw):
    """A hand leads a joint, with tremor; an encoder with noise is read."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    rate_hz = draw(st.sampled_from([10.0, 20.0, 33.0, 50.0, 100.0, 200.0, 1000.0]))
    per_turn = 1 << draw(st.sampled_from([12, 13, 14, 16, 17, 20, 23]))
    noise_counts = draw(st.sampled_from([0.0, 0.3, 1.0, 3.0]))
    times_s = np.arange(1500) / rate_hz
    places_rad, at_s, place_rad = np.zeros(1500), 0.0, 0.0
    while at_s < times_s[-1]:
        rest_s, moves_s = rng.uniform(0.05, 0.8), rng.uniform(0.15, 1.5)
        way_rad = rng.uniform(-0.6, 0.6)
        share = np.clip((times_s - at_s - rest_s) / moves_s, 0.0, 1.0)
        places_rad += way_rad * share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
        at_s, place_rad = at_s + rest_s + moves_s, place_rad + way_rad
    tremor_rad = rng.uniform(0.0, 1e-3)
    places_rad += tremor_rad * np.sin(2 * np.pi * rng.uniform(6, 12) * times_s)
    noise = noise_counts * rng.standard_normal(1500)
    counts = np.rint(places_rad * per_turn / (2.0 * np.pi) + noise).astype(int)
    return rate_hz, per_turn, counts


@given(hand_motions())
def test_no_hand_repeats_a_count(motion):
    rate_hz, per_turn, counts = motion
    repeats = Board(rate_hz, per_turn).read(counts)
    assert not any(repeat.is_clear for repeat in repeats)
    # A single one may be chance; the daemon doubts two within half a minute.
    assert len(repeats) <= 1


@given(st.data())
def test_a_repeat_in_a_hands_motion_shows(data):
    """From 1.5 mrad at 100 Hz, wherever in the motion it is."""
    rng = np.random.default_rng(data.draw(st.integers(0, 2**32)))
    times_s = np.arange(400) / 100.0
    swing_rad = 0.5 * np.sin(2.0 * np.pi * 0.4 * times_s + rng.uniform(0.0, 6.0))
    counts = np.rint(swing_rad / RAD).astype(int)
    steps_rad = np.abs(np.diff(counts, prepend=counts[0])) * RAD
    rows = np.flatnonzero((steps_rad > 1.5e-3) & (np.arange(400) > 250))
    row = data.draw(st.sampled_from(rows[rows < 395].tolist()))
    counts[row] = counts[row - 1]
    (repeat,) = Board().read(counts)
    assert repeat.since_ns == START_NS + (row - 1) * 10_000_000
