import asyncio
import math
from collections.abc import Callable

import numpy as np
import pytest
from pydantic import ValidationError

from benchmarks.virtual_time import Cable, Straight, VirtualTime, played
from drivers.amt21 import Amt21, Amt21Options
from drivers.crossing import Crossing
from drivers.values import (
    STATUS_MISSING,
    CountSamples,
    DeviceAlarm,
    DeviceCounters,
    DeviceError,
    DeviceFault,
    DeviceLost,
    DeviceUp,
    StreamStarted,
)
from tests.drivers.driver_contract import DriverContract, StreamContract
from tests.drivers.fake_amt21 import (
    FakeEncoder,
    FakeLine,
    PtyEncoders,
    VirtualEncoders,
    word,
)

ADDRESSES = (0x54, 0x58, 0x5C)


class Played:
    """A line with a driver on it, in virtual time, and what it has delivered."""

    def __init__(
        self,
        line: FakeLine,
        seconds: float = 1.0,
        rate_hz: float = 100.0,
        at: dict[float, Callable[["Played"], object]] | None = None,
        **options,
    ) -> None:
        self.time = VirtualTime(seconds)
        self.cable = Cable(self.time)
        self.line = line
        self.peer = VirtualEncoders(line, self.cable)
        self.time.devices = [self.peer, self]
        self._at = sorted((at or {}).items())
        straight = Straight(self.time.over)
        self.driver = Amt21(
            "arm",
            straight,
            port="somewhere",
            addresses=tuple(line.encoders),
            monotonic_ns=self.time.monotonic_ns,
            wait_for=self.time.wait_for,
            open_port=self.cable.open_port,
            **options,
        )
        self.driver.request_stream(rate_hz)
        played(self.driver, self.time.over)
        self.all = straight.all

    def live(self, now_s: float) -> None:
        while self._at and self._at[0][0] <= now_s:
            self._at.pop(0)[1](self)

    def next_due_s(self, block_s: float) -> float:
        return self._at[0][0] if self._at else math.inf

    def of(self, kind):
        return [one for one in self.all if isinstance(one, kind)]

    def joined(self, name: str) -> np.ndarray:
        return np.concatenate([getattr(b, name) for b in self.of(CountSamples)])

    def missing(self) -> np.ndarray:
        """(n, n_channels) of samples that lack a reading."""
        return (self.joined("status") & STATUS_MISSING) != 0

    def alarms(self) -> list[tuple[int | None, bool]]:
        return [(alarm.channel, alarm.raised) for alarm in self.of(DeviceAlarm)]

    def counters(self) -> dict[str, int]:
        return dict(self.of(DeviceCounters)[-1].values)


def line(n: int = 3, *, echo: bool = False, **encoder) -> FakeLine:
    made = FakeLine(*ADDRESSES[:n], echo=echo)
    for number, address in enumerate(made.encoders):
        made.encoders[address] = FakeEncoder(count=1000 * (number + 1), **encoder)
    return made


@pytest.mark.parametrize("echo", [False, True])
@pytest.mark.parametrize("option", ["auto", "told"])
def test_every_encoder_is_read_whether_the_adapter_echoes_or_not(echo, option):
    told = {"auto": "auto", "told": "yes" if echo else "no"}[option]
    run = Played(line(echo=echo), echo=told)
    (up,) = run.of(DeviceUp)
    assert up.identity.moduli_counts == (16384,) * 3
    assert up.identity.counts_per_turn == (16384,) * 3
    assert not up.identity.latches
    assert (run.joined("counts") == [1000, 2000, 3000]).all()
    assert not run.joined("status").any()
    assert run.of(DeviceFault) == []
    assert run.counters()["echoed"] == echo


def test_the_stream_keeps_its_instants():
    run = Played(line(), rate_hz=250.0)
    assert (np.diff(run.joined("seq")) == 1).all()
    assert (np.diff(run.joined("sample_time_ns")) == 4_000_000).all()
    assert run.of(StreamStarted)[0].rate_hz == 250.0


def test_a_reading_is_stamped_in_the_middle_of_its_exchange():
    """At a steady speed the count tells when it was latched: with the request."""
    moving = line(3, delay_s=0.0004, speed_counts_s=1e5)
    run = Played(moving, rate_hz=100.0, max_speed_rad_s=100.0)
    # 0.4 ms an exchange, one after the other; the middle is 0.2 ms after the latch.
    assert run.joined("skew_ns").tolist() == [[200_000, 600_000, 1_000_000]] * len(
        run.joined("seq")
    )
    read_ns = run.joined("sample_time_ns")[:, np.newaxis] + run.joined("skew_ns")
    latched_s = (read_ns - 200_000 - 10**12) * 1e-9
    expected = np.array([1000, 2000, 3000]) + 1e5 * latched_s
    off = (run.joined("counts") - np.rint(expected) + 8192) % 16384 - 8192
    assert np.abs(off).max() <= 1


def test_models_of_12_bits_send_their_value_times_four():
    made = line(2)
    made.encoders[0x54].count = 4 * 1234
    made.encoders[0x58].count = 4 * 4095
    run = Played(made, bits=12)
    assert run.of(DeviceUp)[0].identity.moduli_counts == (4096, 4096)
    assert (run.joined("counts") == [1234, 4095]).all()


def test_an_encoder_with_more_bits_than_configured_is_an_alarm_with_a_remedy():
    made = line(2)
    made.encoders[0x58].count = 4 * 17 + 1
    run = Played(made, bits=12)
    assert run.alarms() == [(1, True)]
    assert "bits = 14" in run.of(DeviceAlarm)[0].remedy


def test_a_rate_beyond_the_line_is_lowered_and_told():
    run = Played(line(3, delay_s=0.001), rate_hz=1000.0)
    (started,) = run.of(StreamStarted)
    assert started.rate_hz == pytest.approx(0.8 / 0.003, rel=1e-3)
    assert run.of(DeviceUp)[0].identity.max_rate_hz == started.rate_hz
    assert [fault.code for fault in run.of(DeviceFault)] == ["rate_limited"]
    assert (np.diff(run.joined("seq")) == 1).all()


def test_a_line_that_becomes_slow_leaves_gaps_that_are_counted():
    def slow(run: Played) -> None:
        run.line.encoders[0x54].late_s = 0.035

    run = Played(line(), rate_hz=100.0, at={0.5: slow}, answer_timeout_s=0.1)
    seq = run.joined("seq")
    lost = int(seq[-1]) + 1 - len(seq)
    assert lost > 0
    faults = [f for f in run.of(DeviceFault) if f.code == "samples_lost"]
    assert sum(fault.count for fault in faults) == lost
    assert not run.missing().any()


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


def test_when_all_are_silent_the_device_is_lost_and_comes_back():
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
    assert before_ns < 10**12 + 1_000_000_000  # told within half a second


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
    run = Played(made, 20.0, rate_hz=200.0)
    good = ~run.missing()[:, 1]
    assert good.sum() < 0.002 * len(good)
    assert not run.missing()[:, [0, 2]].any()


def test_an_encoder_that_really_has_moved_meanwhile_is_believed_again():
    def turn(run: Played) -> None:
        run.line.encoders[0x54].count += 8000

    run = Played(line(), 3.0, at={0.5: turn})
    assert run.alarms() == [(0, True), (0, False)]
    assert run.joined("counts")[-1, 0] == 9000


def test_turns_make_one_count_that_goes_on():
    made = line(2)
    made.encoders[0x54].count = 3 * 16384 - 5
    made.encoders[0x58].count = -16384 + 7
    made.encoders[0x54].speed_counts_s = 40_000.0
    made.encoders[0x58].speed_counts_s = -40_000.0
    run = Played(made, 3.0, turns=True, max_speed_rad_s=30.0)
    assert run.of(DeviceUp)[0].identity.moduli_counts == (1 << 28,) * 2
    counts = run.joined("counts").astype(np.int64)
    seconds = (run.joined("sample_time_ns") - 10**12)[:, np.newaxis] * 1e-9
    latched_s = seconds + run.joined("skew_ns") * 1e-9 - 0.0001
    expected = np.array([3 * 16384 - 5, -16384 + 7]) + latched_s * [40e3, -40e3]
    off = (counts - np.rint(expected).astype(np.int64) + (1 << 27)) % (1 << 28)
    assert np.abs(off - (1 << 27)).max() <= 1
    assert run.of(DeviceFault) == []


def test_turns_that_the_encoder_counts_differently_are_told():
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


def test_without_a_stream_a_lost_encoder_is_noticed_too():
    def silence(run: Played) -> None:
        run.line.encoders[0x58].silent = math.inf

    run = Played(line(), 4.0, rate_hz=0.0, at={1.0: silence})
    assert run.of(CountSamples) == []
    assert run.alarms() == [(1, True)]


def test_nothing_on_the_line_is_told_with_what_to_check():
    made = line(2)
    for encoder in made.encoders.values():
        encoder.silent = math.inf
    run = Played(made)
    (lost,) = run.of(DeviceLost)
    assert "nothing answers at 2 addresses" in lost.reason
    assert "addresses" in lost.remedy


def test_an_echo_that_cannot_be_told_asks_for_the_option():
    made = line(1)
    made.encoders[0x54].answer = lambda reply: b"\x00\x00\x00\x00"
    run = Played(made)
    (lost,) = run.of(DeviceLost)
    assert "echoes" in lost.reason
    assert 'echo = "yes"' in lost.remedy


def test_it_only_ever_asks():
    """No zero set and no reset is sent by reading."""
    run = Played(line(), 2.0, turns=True)
    assert {byte & 3 for byte in run.line.heard} <= {0, 1}


@pytest.mark.parametrize(
    "bad",
    [
        {"addresses": ()},
        {"addresses": (0x55,)},
        {"addresses": (0x54, 0x54)},
        {"addresses": (0x54,), "bits": 13},
        {"addresses": (0x54,), "echo": "maybe"},
        {"addresses": (0x54,), "max_speed_rad_s": 0.0},
    ],
)
def test_options_are_strict(bad):
    with pytest.raises(ValidationError):
        Amt21Options(port="p", **bad)


class Amt21Rig:
    """Real bytes through a pty; the count of each encoder rises as it is asked."""

    def __init__(self, encoders: PtyEncoders) -> None:
        self.encoders = encoders
        self.port = str(encoders.link)
        self.crossing = Crossing(asyncio.get_running_loop())
        self.driver = Amt21(
            "base",
            self.crossing,
            port=self.port,
            addresses=ADDRESSES,
            echo="no",
            answer_timeout_s=0.25,
        )

    def emit(self, n):
        """They answer when they are asked."""

    def lose(self, n):
        self.encoders.line.encoders[0x58].garbled = n

    def unplug(self):
        self.encoders.unplug()

    def plug(self):
        self.encoders.plug()


class TestContract(DriverContract, StreamContract):
    rate_hz = 200.0
    parts = (1, 7, 40)

    @pytest.fixture
    async def rig(self, tmp_path):
        encoders = PtyEncoders(line(step=1), tmp_path / "line")
        encoders.plug()
        rig = Amt21Rig(encoders)
        yield rig
        rig.driver.close()
        encoders.unplug()


async def test_it_cannot_latch_at_a_moment_of_its_own(tmp_path):
    crossing = Crossing(asyncio.get_running_loop())
    driver = Amt21("base", crossing, port=str(tmp_path), addresses=(0x54,))
    with pytest.raises(DeviceError, match="cannot latch"):
        driver.request_latch()
    driver.close()
