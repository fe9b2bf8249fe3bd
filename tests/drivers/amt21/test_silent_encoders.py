"""AMT21 encoders that do not answer: one, some, all.

Invalid bytes on a line of AMT21 encoders.
Driver and simulated line together: what is believed was true when it was read.
"""

import math

import numpy as np
import pytest

from benchmarks.drivers.moving_arm import Case, moving, read_virtually
from tests.drivers.amt21.fake_encoders import word
from tests.drivers.amt21.virtual_run import Played, line
from traverse.drivers.base.values import (
    STATUS_MISSING,
    CountSamples,
    DeviceAlarm,
    DeviceFault,
    DeviceLost,
    DeviceUp,
    StreamStarted,
)


def test_a_missed_reading_repeats_the_last_count_and_says_so():
    def miss(run: Played) -> None:
        run.line.encoders[0x58].silent = 1
        run.line.encoders[0x5C].garbled = 1

    run = Played(line(step=1), at={0.5: miss})
    missing = run.missing()
    assert missing.sum(axis=0).tolist() == [0, 1, 1]
    counts = run.joined("counts").astype(int)
    row = int(np.flatnonzero(missing[:, 1])[0])
    assert counts[row, 1] == counts[row - 1, 1]
    counters = run.counters()
    assert (counters["silent"], counters["garbled"]) == (1, 1)
    assert (counters["missed_1"], counters["missed_2"]) == (1, 1)
    faults = [f for f in run.of(DeviceFault) if f.code == "readings_missing"]
    assert sum(fault.count for fault in faults) == 2
    assert run.alarms() == []


def test_a_silent_encoder_is_an_alarm_that_ends_and_does_not_stop_the_others():
    def silence(run: Played) -> None:
        run.line.encoders[0x58].silent = math.inf

    def speak(run: Played) -> None:
        run.line.encoders[0x58].silent = 0

    run = Played(line(step=1), 3.0, at={0.5: silence, 1.7: speak})
    assert run.alarms() == [(1, True), (1, False)]
    raised, _ = run.of(DeviceAlarm)
    assert raised.code == "encoder_missing"
    assert "0x58" in raised.text
    assert "does not answer" in raised.text
    assert raised.remedy
    missing = run.missing()
    assert not missing[:, [0, 2]].any()
    assert 110 < missing[:, 1].sum() < 190
    # It costs the others no more than the first three time-outs and a look each 0.5 s.
    seq = run.joined("seq")
    assert len(seq) > 0.9 * seq[-1]
    assert run.of(DeviceLost) == []


def test_an_encoder_that_was_away_may_be_another():
    def silence(run: Played) -> None:
        run.line.encoders[0x58].silent = math.inf

    def speak(run: Played) -> None:
        run.line.encoders[0x58].silent = 0

    run = Played(line(step=1), 5.0, at={0.5: silence, 3.2: speak})
    (lost,) = run.of(DeviceLost)
    assert "0x58 was away for" in lost.reason
    assert "no serial number" in lost.reason
    assert len(run.of(DeviceUp)) == 2


def test_an_encoder_that_never_answered_is_an_alarm_right_after_the_start():
    made = line(3)
    made.encoders[0x5C].silent = math.inf
    run = Played(made)
    kinds = [type(delivery) for delivery in run.all]
    assert kinds.index(DeviceUp) < kinds.index(DeviceAlarm) < kinds.index(CountSamples)
    assert run.alarms() == [(2, True)]
    assert run.missing()[:, 2].all()


def test_when_all_are_silent_the_device_is_lost_and_returns():
    def silence(run: Played) -> None:
        for encoder in run.line.encoders.values():
            encoder.silent = math.inf

    def speak(run: Played) -> None:
        for encoder in run.line.encoders.values():
            encoder.silent = 0

    run = Played(line(), 4.0, at={0.5: silence, 2.0: speak})
    (lost,) = [lost for lost in run.of(DeviceLost) if "0x54" in lost.reason]
    assert lost.remedy
    assert len(run.of(DeviceUp)) == 2
    first, second = run.of(StreamStarted)
    assert first.stream != second.stream
    kinds = [type(delivery) for delivery in run.all]
    before_ns = max(
        int(b.sample_time_ns[-1])
        for b in run.all[: kinds.index(DeviceLost)]
        if isinstance(b, CountSamples)
    )
    assert before_ns < 10**12 + 1_000_000_000  # reported within half a second


def test_without_a_stream_a_lost_encoder_is_noticed_too():
    def silence(run: Played) -> None:
        run.line.encoders[0x58].silent = math.inf

    run = Played(line(), 4.0, rate_hz=0.0, at={1.0: silence})
    assert run.of(CountSamples) == []
    assert run.alarms() == [(1, True)]


def test_nothing_on_the_line_is_reported_with_what_to_check():
    made = line(2)
    for encoder in made.encoders.values():
        encoder.silent = math.inf
    run = Played(made)
    (lost,) = run.of(DeviceLost)
    assert "nothing answers at 2 addresses" in lost.reason
    assert "addresses" in lost.remedy


def test_a_jump_that_passes_the_check_bits_is_stopped_by_the_speed_limit():
    def spoil(run: Played) -> None:
        run.line.encoders[0x54].answer = wrong_once

    def wrong_once(reply: bytes) -> bytes:
        run_line.encoders[0x54].answer = bytes
        return word(9000)

    run_line = line()
    run = Played(run_line, at={0.5: spoil})
    assert (run.joined("counts")[:, 0] == 1000).all()
    assert run.missing()[:, 0].sum() == 1
    assert run.counters()["implausible"] == 1


def test_of_random_words_hardly_any_gets_through():
    """Check bits pass one in four, the speed limit one in sixteen of those."""
    draw = np.random.default_rng(6)

    def noise(reply: bytes) -> bytes:
        return draw.bytes(2)

    made = line(3)
    made.encoders[0x58].answer = noise
    run = Played(made, 8.0, rate_hz=200.0)
    good = ~run.missing()[:, 1]
    assert good.sum() < 0.002 * len(good)
    assert not run.missing()[:, [0, 2]].any()


def test_an_encoder_that_really_has_moved_meanwhile_is_believed_again():
    def turn(run: Played) -> None:
        run.line.encoders[0x54].count += 8000

    run = Played(line(), 3.0, at={0.5: turn})
    assert run.missing()[:, 0].sum() == 1
    assert run.joined("counts")[-1, 0] == 9000


def test_an_encoder_with_more_bits_than_configured_is_an_alarm_with_a_remedy():
    made = line(2)
    made.encoders[0x58].count = 4 * 17 + 1
    run = Played(made, bits=12)
    assert run.alarms() == [(1, True)]
    assert "bits = 14" in run.of(DeviceAlarm)[0].remedy


def test_turns_that_the_encoder_counts_differently_are_reported():
    def lose_turns(run: Played) -> None:
        run.line.encoders[0x54].count %= 16384

    made = line(1)
    made.encoders[0x54].count = 5 * 16384 + 100
    run = Played(made, 4.0, at={0.5: lose_turns}, turns=True)
    codes = [fault.code for fault in run.of(DeviceFault)]
    assert codes.count("turns_corrected") == 1
    counts = run.joined("counts")[:, 0]
    assert counts[0] == 5 * 16384 + 100
    assert counts[-1] == 100


CASE = Case(0.0005, 0.0002, 100.0, sway_hz=0.5)
SECONDS = 4.0
TURN = 16384
SILENT = {"kind": "silent", "channel": 3, "at_s": 1.0, "duration_s": 1.0}
RESET = {"kind": "reset", "channel": 5, "at_s": 2.0, "duration_s": 0.2}


def line_fault(kind, probability=0.01, **options):
    return {"kind": kind, "probability": probability, **options}


@pytest.mark.parametrize(
    "faults",
    [
        (),
        (line_fault("lost"),),
        (line_fault("corrupted", 0.02),),
        (line_fault("check", 0.02),),
        (line_fault("garbage", 0.005),),
        (line_fault("repeated"),),
        (line_fault("late", delay_s=0.004), line_fault("late", delay_s=0.012)),
        (SILENT, RESET),
    ],
    ids=lambda faults: " ".join(fault["kind"] for fault in faults) or "good",
)
def test_what_is_believed_was_true_when_it_was_read(tmp_path, faults):
    arm = moving(tmp_path, CASE, SECONDS, faults)
    result, first_ns = read_virtually(arm, CASE, SECONDS)
    blocks = [delivery for delivery in result if isinstance(delivery, CountSamples)]
    counts = np.concatenate([b.counts for b in blocks]).astype(np.int64)
    missing = np.concatenate([b.status for b in blocks]) & STATUS_MISSING != 0
    seq = np.concatenate([b.seq for b in blocks])
    instants_ns = np.concatenate([b.sample_time_ns for b in blocks])
    skews_ns = np.concatenate([b.skew_ns for b in blocks if b.skew_ns is not None])
    assert missing.mean() < (0.08 if faults else 1e-9)
    for channel in range(7):
        read_s = (instants_ns + skews_ns[:, channel] - first_ns) * 1e-9
        readings_rad = arm.course.readings_rad(read_s)
        true = arm.mounting.encoders.counts(readings_rad, np.random.default_rng(0))
        off = (counts[:, channel] - true[:, channel] + TURN // 2) % TURN - TURN // 2
        good = ~missing[:, channel]
        # At 1 rad/s half of 5 ms, the longest exchange that is believed, is 7 counts.
        assert np.abs(off[good]).max() <= 7
        assert good.any()
    lost = [
        f for f in result if isinstance(f, DeviceFault) and f.code == "samples_lost"
    ]
    assert seq[-1] + 1 - len(seq) == sum(fault.count for fault in lost)
    assert not any(isinstance(delivery, DeviceLost) for delivery in result)
    alarms = [
        delivery.channel for delivery in result if isinstance(delivery, DeviceAlarm)
    ]
    assert set(alarms) <= ({3, 5} if faults == (SILENT, RESET) else set())
