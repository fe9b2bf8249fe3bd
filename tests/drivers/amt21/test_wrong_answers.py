"""Invalid bytes on a line of AMT21 encoders."""

import numpy as np

from tests.drivers.amt21.fake_encoders import word
from tests.drivers.amt21.virtual_run import Played, line
from traverse.drivers.base.values import DeviceAlarm, DeviceFault


def test_a_late_reply_is_never_taken_for_that_of_the_next_encoder():
    def late(run: Played) -> None:
        run.line.encoders[0x54].late_s = 0.0049 + 0.0007 * len(done)
        done.append(run.time.now_s)

    done: list[float] = []
    at = {0.5 + 0.1 * k: late for k in range(12)}
    run = Played(line(), 2.0, at=at)
    counts = run.joined("counts")
    assert (counts == [1000, 2000, 3000]).all()
    assert run.missing().any()
    assert run.counters()["stray_bytes"] >= 20
    assert run.alarms() == []


def test_stray_bytes_make_a_cycle_missing_and_not_wrong():
    def stray(run: Played) -> None:
        run.peer.strays.append((run.time.now_s + 0.0001, word(1500)))

    at = {0.5 + 0.0537 * k: stray for k in range(20)}
    run = Played(line(step=1), 2.0, at=at)
    counts = run.joined("counts").astype(int)
    assert (np.abs(np.diff(counts, axis=0)) < 100).all()
    good = ~run.missing()
    for channel, first in enumerate((1000, 2000, 3000)):
        assert (counts[good[:, channel], channel] // 1000 == first // 1000).all()


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
    assert run.alarms() == [(0, True), (0, False)]
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
