"""AMT21 encoders that do not answer: one, some, all."""

import math

import numpy as np

from tests.drivers.amt21.virtual_run import Played, line
from traverse.drivers.base.values import (
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
    told = [f for f in run.of(DeviceFault) if f.code == "readings_missing"]
    assert sum(fault.count for fault in told) == 2
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


def test_an_encoder_that_never_answered_is_an_alarm_right_after_the_start():
    made = line(3)
    made.encoders[0x5C].silent = math.inf
    run = Played(made)
    kinds = [type(one) for one in run.all]
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
    kinds = [type(one) for one in run.all]
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
