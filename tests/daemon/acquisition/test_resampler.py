"""The assembly against the true motion, interpolated by other means.

An assembly where readings are late, lost, not valid or out of order.
"""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.daemon.acquisition.resampled import (
    AT_ONCE,
    MUCH_LATER,
    interpolated,
    joined,
    off_counts,
)
from tests.daemon.two_devices import (
    BEGIN_NS,
    TURNS,
    assembly_on_two,
    base,
    identity,
    true_counts,
    wrist,
)
from traverse.daemon.acquisition.interpolation import (
    EncoderReadings,
    InterpolationLimits,
    interpolate,
)
from traverse.daemon.acquisition.joint_stream import KEPT_NS
from traverse.drivers.base.values import (
    STATUS_ERROR,
    STATUS_INTERPOLATED,
    STATUS_LATE,
    STATUS_MISSING,
    LatchedCounts,
)


def cuts(draw, n):
    bounds = sorted({0, n, *draw(st.lists(st.integers(1, n - 1), max_size=8))})
    return [range(a, b) for a, b in pairwise(bounds)]


@settings(max_examples=40)
@given(data=st.data())
def test_every_sample_once_and_as_interpolation_by_other_means_has_it(
    data, tmp_path_factory
):
    folder = tmp_path_factory.mktemp("arm")
    skews = st.lists(st.integers(0, 9_000_000), min_size=3, max_size=3)
    base_skew_ns = data.draw(st.one_of(st.none(), skews.map(tuple)))
    first_ns = BEGIN_NS + data.draw(st.integers(-20_000_000, 40_000_000))
    readers = {
        "base": base(skew_ns=base_skew_ns),
        "wrist": wrist(
            rate_hz=(rate_hz := data.draw(st.sampled_from([40.0, 80.0, 330.0]))),
            skew_ns=(0, data.draw(st.integers(0, 2_000_000))),
            first_ns=first_ns,
        ),
    }
    assembly = assembly_on_two(folder, (100.0, rate_hz), wait_s=1.0)
    numbers = {"base": range(60), "wrist": range(int(0.6 * rate_hz) + 8)}
    blocks = {
        device: cuts(data.draw, len(numbers[device])) for device in ("base", "wrist")
    }
    made = []
    while any(blocks.values()):
        device = data.draw(st.sampled_from([d for d, left in blocks.items() if left]))
        assembly.add(readers[device].samples(blocks[device].pop(0)), AT_ONCE)
        made += assembly.resampled(AT_ONCE)
    seq, times_ns, counts, status, _ = joined(made)
    # All of those, and only those, for which every joint was read before and after.
    reading_ns = [
        readers[d].reading_times_ns(numbers[d], j)
        for d, j in (("base", 0), ("base", 1), ("wrist", 2))
    ]
    all_ns = readers["base"].times_ns(numbers["base"])
    good = all_ns >= max(r[0] for r in reading_ns)
    good &= all_ns <= min(r[-1] for r in reading_ns)
    np.testing.assert_array_equal(seq, np.flatnonzero(good))
    np.testing.assert_array_equal(times_ns, all_ns[good])
    expected = np.stack(
        [
            interpolated(readers[d], numbers[d], j, times_ns)
            for d, j in (("base", 0), ("base", 1), ("wrist", 2))
        ],
        axis=1,
    )
    assert np.abs(off_counts(counts, expected)).max() < 1e-6
    assert (status & ~np.uint8(STATUS_INTERPOLATED) == 0).all()
    if base_skew_ns is None:
        assert (status[:, :2] == 0).all()
    assert assembly.dropped["wrist"] + assembly.dropped["base"] > 0 or good[0]


@pytest.mark.parametrize("speed", [0.2, 1.0, 3.0])
def test_the_doubt_is_about_what_interpolation_leaves(tmp_path, speed):
    assembly = assembly_on_two(tmp_path)
    assembly.add(wrist(speed=speed).samples(range(500)), AT_ONCE)
    assembly.add(base(speed=speed).samples(range(500)), AT_ONCE)
    _, times_ns, counts, _, doubts = joined(assembly.resampled(AT_ONCE))
    off = np.abs(off_counts(counts, true_counts(times_ns, speed)))[:, 2]
    # Rounding of both readings is half a count at most, and no doubt of ours.
    # A steady acceleration leaves half of the bound.
    assert (off <= 0.5 + 0.65 * doubts[:, 2] + 1.0).all()
    if speed >= 1.0:
        worst = np.argsort(off)[-50:]
        assert (off[worst] > 0.45 * doubts[worst, 2]).all()
    assert (doubts[:, :2] == 0).all()


@pytest.mark.parametrize("begins_s", [0.4, 0.45, 0.5])
def test_a_joint_that_begins_to_move_between_readings_is_within_its_bound(begins_s):
    """On a line that is read at 5 Hz: four times the bound is what is allowed."""

    def counts_at(seconds):
        return 1e5 * np.maximum(seconds - begins_s, 0.0) ** 2

    read_s, instants_s = np.arange(4) * 0.2, np.arange(0.41, 0.6, 0.01)
    zeros = np.zeros(4, np.int64)
    readings = EncoderReadings(
        np.rint(1e9 * read_s).astype(np.int64),
        np.rint(counts_at(read_s)).astype(np.int64),
        *(zeros.astype(np.uint8), np.arange(4), zeros),
    )
    instants_ns = np.rint(1e9 * instants_s).astype(np.int64)
    limits = InterpolationLimits(max_gap_ns=10**9, late_ns=0)
    at_instants = interpolate(readings, instants_ns, limits)
    off = np.abs(at_instants.counts + at_instants.fractions - counts_at(instants_s))
    assert (off <= 4.0 * at_instants.error_bounds_counts[:, 0] + 1.0).all()


def test_an_arm_at_rest_is_in_no_doubt(tmp_path):
    assembly = assembly_on_two(tmp_path)
    rng = np.random.default_rng(5)
    still = wrist(speed=0.0).samples(range(400))
    flicker = rng.integers(0, 2, still.counts.shape).astype(np.uint32)
    assembly.add(replace(still, counts=still.counts + flicker), AT_ONCE)
    assembly.add(base(speed=0.0).samples(range(400)), AT_ONCE)
    *_, doubts = joined(assembly.resampled(AT_ONCE))
    assert doubts.max() == 0.0


def test_stamps_that_may_be_off_count_by_the_speed(tmp_path):
    assembly = assembly_on_two(tmp_path)
    assembly.on_up("wrist", identity(200_000), restarted=False)
    assembly.add(wrist().samples(range(100)), AT_ONCE)
    assembly.add(base().samples(range(100)), AT_ONCE)
    made = assembly.resampled()
    _, times_ns, _, _, _ = joined(made)
    bounds_counts = np.concatenate([bounds[:, :, 1] for _, bounds in made])
    before, after = true_counts(times_ns - 100_000), true_counts(times_ns + 100_000)
    expected = np.abs(after - before)[:, 2]
    inside = bounds_counts[:, 2] > 0.0  # not where a reading fell on the very instant
    assert bounds_counts[inside, 2] == pytest.approx(
        expected[inside], abs=0.02 * expected.max()
    )
    assert inside.sum() > 70
    assert (bounds_counts[:, :2] == 0).all()


def latched(reader, time_ns):
    true = np.rint(true_counts(np.array([time_ns])))[0].astype(np.int64) % TURNS
    counts = [0 if joint is None else int(true[joint]) for joint in reader.channels]
    return LatchedCounts(
        reader.device,
        0,
        True,
        0,
        0,
        time_ns,
        time_ns,
        tuple(counts),
        (0,) * len(counts),
    )


def test_a_single_instant_takes_what_was_latched_and_interpolates_the_rest(tmp_path):
    assembly = assembly_on_two(tmp_path)
    assembly.add(base().samples(range(50)), AT_ONCE)
    instant_ns = BEGIN_NS + 333_333_333
    latch = latched(base(), instant_ns)
    assert assembly.at(instant_ns, latch) is None
    assert (
        assembly.missing_reason(instant_ns, latch)
        == "wrist has not read all its joints yet"
    )
    assembly.add(wrist().samples(range(20)), AT_ONCE)
    assert assembly.at(instant_ns, latch) is None
    assert (
        assembly.missing_reason(instant_ns, latch)
        == "no readings of wrist arrived after it"
    )
    assembly.add(wrist().samples(range(20, 40)), AT_ONCE)
    reading = assembly.at(instant_ns, latch)
    assert reading.status.tolist() == [0, 0, STATUS_INTERPOLATED]
    counts = (reading.counts + reading.fractions)[np.newaxis]
    true = true_counts(np.array([instant_ns]))
    assert np.abs(off_counts(counts, true)[0, :2]).max() <= 0.5
    assert reading.fractions[:2].tolist() == [0.0, 0.0]
    expected = interpolated(wrist(), range(40), 2, np.array([instant_ns]))[0]
    assert off_counts(counts[0, 2], expected, 2) == pytest.approx(0.0, abs=1e-6)
    # At the edge of a device without joints all of them are interpolated.
    foreign = LatchedCounts("handle", 0, True, 0, 0, 0, instant_ns, (), ())
    for none in (foreign, None):
        bits = assembly.at(instant_ns, none).status
        assert bits.tolist() == [STATUS_INTERPOLATED] * 3


def test_an_instant_that_is_long_past_is_not_guessed(tmp_path):
    assembly = assembly_on_two(tmp_path)
    n = int(KEPT_NS * 1e-9 * 80) + 100
    for first in range(0, n, 20):
        assembly.record(wrist().samples(range(first, first + 20)))
        assembly.record(base().samples(range(first, first + 20)))
    assert assembly.at(BEGIN_NS + 100_000_000, None) is None
    reason = assembly.missing_reason(BEGIN_NS + 100_000_000, None)
    assert reason == "it is older than the readings of wrist that are kept"


def test_a_clock_that_is_not_the_first_joints_device_gives_the_instants(tmp_path):
    assembly = assembly_on_two(tmp_path, clock="wrist")
    assembly.add(base().samples(range(50)), AT_ONCE)
    assembly.add(wrist().samples(range(30)), AT_ONCE)
    seq, times_ns, _, status, _ = joined(assembly.resampled(AT_ONCE))
    assert seq.tolist() == list(range(30))
    assert (times_ns == wrist().times_ns(range(30))).all()
    assert (status[:, 2] == 0).all()


def held_back(tmp_path, **settings):
    """Deliver 10 samples of the wrist, to 112.5 ms, and 20 of the base, to 190 ms."""
    assembly = assembly_on_two(tmp_path, wait_s=0.05, **settings)
    assembly.add(wrist().samples(range(10)), AT_ONCE)
    assembly.add(base().samples(range(20)), AT_ONCE)
    seq, *_ = joined(assembly.resampled(AT_ONCE))
    assert seq.tolist() == list(range(12))
    assert assembly.resampled(AT_ONCE + 49_000_000) == []
    return assembly


def test_what_waits_too_long_is_reported_late_and_then_incomplete(tmp_path):
    assembly = held_back(tmp_path)
    seq, _, counts, status, doubts = joined(assembly.resampled(AT_ONCE + 50_000_000))
    assert seq.tolist() == list(range(12, 20))
    last = true_counts(wrist().times_ns([9]))[0, 2]
    assert np.abs(off_counts(counts[:, 2], last, 2)).max() < 0.51
    # To 162.5 ms the last reading is no older than what is waited for.
    assert (status[:5, 2] == STATUS_LATE).all()
    assert (status[5:, 2] == STATUS_MISSING).all()
    assert (status[:, :2] == 0).all()
    assert (assembly.late["wrist"], assembly.incomplete["wrist"]) == (5, 3)
    assert (assembly.late["base"], assembly.incomplete["base"]) == (0, 0)
    true = true_counts(base().times_ns(seq))[:, 2]
    gone = np.abs(true - last)
    assert (gone < 1.3 * doubts[:, 2] + 1).all()


def test_by_policy_what_is_late_or_incomplete_is_held_back(tmp_path):
    assembly = held_back(tmp_path, policy="drop")
    assert assembly.resampled(AT_ONCE + 50_000_000) == []
    assert assembly.dropped == {"wrist": 8, "base": 0}
    assert assembly.lacks()["wrist"] == {
        "samples_late": 5,
        "samples_incomplete": 3,
        "samples_held_back": 8,
    }


def test_nothing_is_waited_for_from_a_lost_device(tmp_path):
    assembly = held_back(tmp_path)
    assembly.on_lost("wrist")
    seq, _, _, status, _ = joined(assembly.resampled(AT_ONCE))
    assert seq.tolist() == list(range(12, 20))
    assert (status[:, 2] == STATUS_MISSING).all()
    # It returns with another stream; the turns continue.
    assembly.on_up("wrist", identity(), restarted=False)
    assembly.set_rate("wrist", 80.0)
    back = wrist(stream=2, first_ns=BEGIN_NS + 500_000_000)
    assembly.add(back.samples(range(30)), AT_ONCE)
    assembly.add(base().samples(range(20, 80)), AT_ONCE)
    seq, times_ns, counts, status, _ = joined(assembly.resampled(AT_ONCE))
    assert seq.tolist() == list(range(20, 80))
    away = times_ns < BEGIN_NS + 500_000_000
    assert (status[away, 2] & STATUS_MISSING != 0).all()
    assert (status[~away, 2] & STATUS_MISSING == 0).all()
    expected = interpolated(back, range(30), 2, times_ns[~away])
    off = off_counts(counts[~away, 2], expected, 2)
    assert np.abs(off).max() < 1e-6


def test_a_reading_lost_on_the_line_is_said_wherever_it_lacks(tmp_path):
    assembly = assembly_on_two(tmp_path)
    numbers = [*range(20), *range(21, 60)]
    assembly.add(wrist().samples(numbers), AT_ONCE)
    assembly.add(base().samples(range(60)), AT_ONCE)
    _, times_ns, _, status, doubts = joined(assembly.resampled(AT_ONCE))
    hole = (times_ns > wrist().times_ns(19)) & (times_ns < wrist().times_ns(21))
    assert (status[hole, 2] == STATUS_MISSING | STATUS_INTERPOLATED).all()
    assert (status[~hole, 2] & STATUS_MISSING == 0).all()
    assert assembly.incomplete["wrist"] == hole.sum() == 3
    around = np.abs(np.flatnonzero(hole)[:, np.newaxis] + [[-3, 3]]).ravel()
    assert doubts[hole, 2].max() > 2 * doubts[around, 2].max()


def test_counts_that_are_not_valid_are_left_out_and_told(tmp_path):
    assembly = assembly_on_two(tmp_path)
    samples = wrist().samples(range(60))
    status = samples.status.copy()
    status[20, 1], status[30:32, 1] = STATUS_ERROR, STATUS_MISSING
    counts = samples.counts.copy()
    counts[20, 1] ^= 0x400000  # half a turn
    assembly.add(replace(samples, counts=counts, status=status), AT_ONCE)
    assembly.add(base().samples(range(60)), AT_ONCE)
    _, times_ns, counts_of_arm, combined, _ = joined(assembly.resampled(AT_ONCE))
    good = [k for k in range(60) if k not in (20, 30, 31)]
    expected = interpolated(wrist(), good, 2, times_ns)
    off = off_counts(counts_of_arm[:, 2], expected, 2)
    assert np.abs(off).max() < 1e-6
    t = wrist().times_ns
    error = (times_ns > t(19)) & (times_ns < t(21))
    missing = (times_ns > t(29)) & (times_ns < t(32))
    assert (combined[error, 2] & (STATUS_ERROR | STATUS_MISSING) == 17).all()
    assert (combined[missing, 2] & (STATUS_ERROR | STATUS_MISSING) == 16).all()
    assert (combined[~error & ~missing, 2] == STATUS_INTERPOLATED).sum() > 40


def test_an_encoder_that_is_dead_from_some_time_on_keeps_its_last_count(tmp_path):
    assembly = assembly_on_two(tmp_path)
    samples = wrist().samples(range(100))
    status = samples.status.copy()
    status[20:, 1] = STATUS_MISSING
    assembly.add(replace(samples, status=status), AT_ONCE)
    assembly.add(base().samples(range(100)), AT_ONCE)
    _, times_ns, counts, combined, _ = joined(assembly.resampled(MUCH_LATER))
    dead = times_ns > wrist().times_ns(19)
    assert (combined[dead, 2] == STATUS_MISSING).all()
    last = np.rint(true_counts(wrist().times_ns([19]))[0, 2])
    assert (off_counts(counts[dead, 2], last, 2) == 0).all()


def test_readings_whose_time_runs_back_are_left_out_or_begin_afresh(tmp_path):
    assembly = assembly_on_two(tmp_path)
    assembly.add(wrist().samples(range(40)), AT_ONCE)
    assembly.add(base().samples(range(20)), AT_ONCE)
    joined(assembly.resampled(AT_ONCE))
    # A little: the clock of the device is being corrected.
    early = base(first_ns=BEGIN_NS - 5_000_000)
    assembly.add(early.samples(range(20, 24)), AT_ONCE)
    # Much: it has begun anew, and what was before no longer counts.
    anew = base(first_ns=BEGIN_NS - 100_000_000, stream=2)
    assembly.add(anew.samples(range(20, 30)), AT_ONCE)
    for samples, _ in assembly.resampled(MUCH_LATER):
        assert (np.diff(samples.sample_time_ns) > 0).all()
        assert np.abs(samples.fractions).max() <= 0.5
