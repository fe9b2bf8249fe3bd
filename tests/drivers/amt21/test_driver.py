import asyncio
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from tests.drivers.amt21.fake_encoders import PtyEncoders
from tests.drivers.amt21.virtual_run import ADDRESSES, Played, line
from traverse.drivers.amt21.driver import Amt21Driver, Amt21Options
from traverse.drivers.base.delivery_queue import DeliveryQueue
from traverse.drivers.base.values import (
    DeviceError,
    DeviceFault,
    DeviceLost,
    DeviceUp,
    StreamStarted,
)
from traverse.testing.driver_contract import DriverContract, StreamContract
from traverse.testing.pty_peer import PeerRig, rig_fixture


@pytest.mark.parametrize("echo", [False, True])
@pytest.mark.parametrize("option", ["auto", "setting"])
def test_every_encoder_is_read_whether_the_adapter_echoes_or_not(echo, option):
    setting = {"auto": "auto", "setting": "yes" if echo else "no"}[option]
    run = Played(line(echo=echo), echo=setting)
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
    """At a steady speed the count shows when it was latched: with the request."""
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


@pytest.mark.parametrize("step", [1, 4])
def test_a_model_of_12_bits_that_is_read_as_14_is_named(step):
    run = Played(line(step=step))
    faults = [fault for fault in run.of(DeviceFault) if fault.code == "fewer_bits"]
    assert len(faults) == (3 if step == 4 else 0)
    assert all("set bits = 12" in fault.remedy for fault in faults)


@pytest.mark.parametrize("speed_counts_s", [0.0, 10.0, 1e5])
def test_an_encoder_that_turns_is_read_again_where_its_reply_was_late(speed_counts_s):
    def delay(run: Played) -> None:
        run.line.encoders[0x58].late_s = 0.003

    moving = line(3, speed_counts_s=speed_counts_s)
    times_s = 0.3 + 0.03 * np.arange(20)
    run = Played(
        moving,
        rate_hz=50.0,
        at=dict.fromkeys(times_s.tolist(), delay),
        max_speed_rad_s=100.0,
    )
    was_late = run.joined("skew_bound_ns") > 1_500_000
    assert was_late.sum() == (0 if speed_counts_s > 1e4 else len(times_s))
    assert not run.missing().any()
    assert (np.diff(run.joined("seq")) == 1).all()


def test_models_of_12_bits_send_their_value_times_four():
    made = line(2)
    made.encoders[0x54].count = 4 * 1234
    made.encoders[0x58].count = 4 * 4095
    run = Played(made, bits=12)
    assert run.of(DeviceUp)[0].identity.moduli_counts == (4096, 4096)
    assert (run.joined("counts") == [1234, 4095]).all()


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


def test_turns_make_one_count_that_continues():
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


class Amt21Rig(PeerRig):
    """Real bytes through a pty; the count of each encoder rises with its requests."""

    def __init__(self, folder: Path) -> None:
        encoders = PtyEncoders(line(step=1), folder / "line")
        options = {"addresses": ADDRESSES, "echo": "no", "answer_timeout_s": 0.25}
        super().__init__(encoders, Amt21Driver, **options)

    def lose(self, n):
        self.peer.line.encoders[0x58].garbled = n


rig = rig_fixture(Amt21Rig)


class TestContract(DriverContract, StreamContract):
    rate_hz = 200.0
    parts = (1, 7, 40)


async def test_it_cannot_latch_at_a_moment_of_its_own(tmp_path):
    delivery_queue = DeliveryQueue(asyncio.get_running_loop())
    driver = Amt21Driver(
        "base", Amt21Options(port=str(tmp_path), addresses=(0x54,)), delivery_queue
    )
    with pytest.raises(DeviceError, match="cannot latch"):
        driver.request_latch()
    driver.close()
