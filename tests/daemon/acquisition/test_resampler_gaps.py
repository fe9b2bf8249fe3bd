"""An assembly where readings are late, lost, not valid or out of order."""

from dataclasses import replace

import numpy as np

from tests.daemon.acquisition.resampled import (
    AT_ONCE,
    MUCH_LATER,
    interpolated,
    joined,
    off_counts,
)
from tests.daemon.two_devices import (
    BEGIN_NS,
    assembly_on_two,
    base,
    identity,
    true_counts,
    wrist,
)
from traverse.drivers.base.values import (
    STATUS_ERROR,
    STATUS_INTERPOLATED,
    STATUS_LATE,
    STATUS_MISSING,
)


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
    _, times_ns, found, told, _ = joined(assembly.resampled(AT_ONCE))
    good = [k for k in range(60) if k not in (20, 30, 31)]
    expected = interpolated(wrist(), good, 2, times_ns)
    off = off_counts(found[:, 2], expected, 2)
    assert np.abs(off).max() < 1e-6
    t = wrist().times_ns
    error = (times_ns > t(19)) & (times_ns < t(21))
    missing = (times_ns > t(29)) & (times_ns < t(32))
    assert (told[error, 2] & (STATUS_ERROR | STATUS_MISSING) == 17).all()
    assert (told[missing, 2] & (STATUS_ERROR | STATUS_MISSING) == 16).all()
    assert (told[~error & ~missing, 2] == STATUS_INTERPOLATED).sum() > 40


def test_an_encoder_that_is_dead_from_some_time_on_keeps_its_last_count(tmp_path):
    assembly = assembly_on_two(tmp_path)
    samples = wrist().samples(range(100))
    status = samples.status.copy()
    status[20:, 1] = STATUS_MISSING
    assembly.add(replace(samples, status=status), AT_ONCE)
    assembly.add(base().samples(range(100)), AT_ONCE)
    _, times_ns, counts, told, _ = joined(assembly.resampled(MUCH_LATER))
    dead = times_ns > wrist().times_ns(19)
    assert (told[dead, 2] == STATUS_MISSING).all()
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
