import numpy as np
import pytest
from pydantic import ValidationError

from tests.drivers.simulated_peer import CountsUp, SimulatedPeer
from tests.drivers.virtual_device import told_by
from tests.simulator.one_hinge import mounted
from traverse.drivers.base.values import (
    STATUS_ERROR,
    STATUS_WARNING,
    DeviceAlarm,
    DeviceFault,
    DeviceLost,
    DeviceTemperatures,
    DeviceUp,
)
from traverse.drivers.rls.driver import RlsDriver
from traverse.drivers.rls.options import RlsOptions
from traverse.simulator.devices.rls import RlsTable, SimulatedRls
from traverse.testing.driver_contract import DriverContract, StreamContract
from traverse.testing.pty_peer import PeerRig, rig_fixture

PORTS = ("a", "b")
FIELD = {"baud_rate": 115_200, "request_delay_s": 2e-4, "reply_delay_s": 2e-4}


def entries_of(folder, *faults, bits=14, many=False, line=None, **options):
    table = RlsTable(
        kind="rls",
        id="wrist",
        ports=PORTS,
        bits=bits,
        encoder_turns=min(65536, 2 ** (32 - bits)) if many else 1,
        **(FIELD if line is None else line),
    )
    return told_by(
        RlsDriver,
        table,
        folder,
        PORTS,
        *faults,
        per_turn=1 << bits,
        ports=PORTS,
        bits=bits,
        turns=many,
        **options,
    )


@pytest.mark.parametrize("bits", [14, 17, 18, 20])
@pytest.mark.parametrize("mode", ["asked", "continuous"])
def test_every_resolution_is_read_in_both_modes(tmp_path, bits, mode):
    run = entries_of(tmp_path, bits=bits, mode=mode)
    (up,) = run.of(DeviceUp)
    assert up.identity.counts_per_turn == (1 << bits,) * 2
    assert up.identity.moduli_counts == (1 << bits,) * 2
    assert not up.identity.latches
    assert "000700, 000701" in up.identity.name
    assert (np.diff(run.joined("seq")) == 1).all()
    assert not run.joined("status").any()
    off = run.joined("counts") - run.counts_at(run.read_ns()) % (1 << bits)
    assert np.abs(off).max() <= 1.0  # 1000 counts a second, within a millisecond
    assert run.of(DeviceFault) == []
    assert run.of(DeviceAlarm) == []


@pytest.mark.parametrize("bits", [14, 17])
def test_turns_make_one_count(tmp_path, bits):
    run = entries_of(tmp_path, bits=bits, many=True, seconds=1.0)
    modulus = min(2**32, 2 ** (bits + 16))
    assert run.of(DeviceUp)[0].identity.moduli_counts == (modulus,) * 2
    off = run.joined("counts") - run.counts_at(run.read_ns())
    assert np.abs(off).max() <= 1.0


def test_all_are_asked_at_once_and_stamped_between_request_and_reply(tmp_path):
    line = {"baud_rate": 10_000, "request_delay_s": 1e-3, "reply_delay_s": 1e-3}
    run = entries_of(tmp_path, line=line, baud_rate=10_000, answer_timeout_s=0.05)
    skews = run.joined("skew_ns")
    # 1 ms there, 1 byte, its latch, 4 or 5 bytes (with a temperature), 1 ms back
    assert (skews == 2_000_000).all()
    assert (run.joined("skew_bound_ns") == 1_000_000).all()
    latched = {round(1e9 * reading[2]) for reading in run.notes.readings}
    assert {int(t) for t in run.read_ns().ravel()} <= latched


def test_in_continuous_mode_a_reading_is_stamped_with_its_latch(tmp_path):
    line = {"baud_rate": 115_200}
    run = entries_of(tmp_path, line=line, mode="continuous", period_us=500)
    latched_ns = np.array([round(1e9 * reading[2]) for reading in run.notes.readings])
    read_ns = run.read_ns().ravel()
    assert np.abs(latched_ns[:, np.newaxis] - read_ns).min(axis=0).max() < 100


def test_status_bits_mark_samples_and_are_alarms_that_end(tmp_path):
    faults = (
        {"kind": "status", "channel": 1, "at_s": 1.0, "duration_s": 1.0, "value": 0x40},
        {"kind": "status", "channel": 0, "at_s": 1.0, "duration_s": 1.0, "bits": 2},
    )
    run = entries_of(tmp_path, *faults, seconds=3.0)
    assert set(run.alarms()) == {
        (1, "encoder_error", True),
        (1, "signal_too_low", True),
        (0, "encoder_warning", True),
        (1, "encoder_error", False),
        (1, "signal_too_low", False),
        (0, "encoder_warning", False),
    }
    assert len(run.alarms()) == 6
    assert all(alarm.remedy for alarm in run.of(DeviceAlarm))
    status = run.joined("status")
    during = (run.read_ns() > 1_001_000_000) & (run.read_ns() < 1_999_000_000)
    assert (status[during[:, 0], 0] == STATUS_WARNING).all()
    assert (status[during[:, 1], 1] == STATUS_ERROR).all()
    assert not status[run.read_ns()[:, 0] > 2_002_000_000].any()


def test_temperatures_come_in_turn_and_cost_no_sample(tmp_path):
    run = entries_of(tmp_path, temperature_period_s=0.2, seconds=1.0)
    temperatures = run.of(DeviceTemperatures)
    assert 8 <= len(temperatures) <= 12
    assert temperatures[-1].values_c == (30.0, 30.0)
    assert not run.missing().any()


def test_without_detail_and_temperature_the_short_way_is_taken(tmp_path):
    run = entries_of(tmp_path, detailed=False, temperature_period_s=0.0)
    assert run.of(DeviceTemperatures) == []
    assert not run.missing().any()


@pytest.mark.parametrize("mode", ["asked", "continuous"])
def test_a_silent_encoder_is_an_alarm_that_ends_and_does_not_stop_the_others(
    tmp_path, mode
):
    reset = {"kind": "reset", "channel": 1, "at_s": 1.0, "duration_s": 1.0}
    run = entries_of(tmp_path, reset, seconds=4.0, mode=mode)
    assert run.alarms() == [(1, "encoder_missing", True), (1, "encoder_missing", False)]
    assert PORTS[1] in run.of(DeviceAlarm)[0].text
    missing = run.missing()
    assert not missing[:, 0].any()
    assert 80 < missing[:, 1].sum() < 180
    assert run.of(DeviceLost) == []
    seq = run.joined("seq")
    assert len(seq) > 0.9 * seq[-1]


def test_late_replies_never_pass_for_the_next(tmp_path):
    """A reading that is a cycle old would be off by ten counts here."""
    late = {"kind": "late", "channel": 0, "probability": 1.0, "duration_s": 0.01}
    faults = [
        {**late, "at_s": 0.5 + 0.1 * k, "delay_s": 0.008 + 0.0007 * k}
        for k in range(40)
    ]
    run = entries_of(tmp_path, *faults, seconds=5.0)
    good = ~run.missing()
    off = run.joined("counts") - run.counts_at(run.read_ns()) % 16384
    assert np.abs(off[good]).max() <= 6.0  # half of an exchange that was nearly late
    assert 36 <= run.missing()[:, 0].sum() <= 120
    assert not run.missing()[:, 1].any()
    assert run.totals["faults"]["late"] >= 38


def test_lost_and_corrupted_replies_leave_no_wrong_counts(tmp_path):
    faults = (
        {"kind": "lost", "probability": 0.02},
        {"kind": "garbage", "probability": 0.02, "seed": 1},
        {"kind": "repeated", "probability": 0.02, "seed": 2},
    )
    run = entries_of(tmp_path, *faults, seconds=5.0)
    good = ~run.missing()
    off = run.joined("counts") - run.counts_at(run.read_ns()) % 16384
    assert np.abs(off[good]).max() <= 2.0
    assert 0.02 < run.missing().mean() < 0.2
    n_told = sum(f.count for f in run.of(DeviceFault) if f.code == "readings_missing")
    assert 0.7 * run.missing().sum() <= n_told <= run.missing().sum() + 8


class LeftRunning(SimulatedRls):
    def power_up(self, now_s):
        super().power_up(now_s)
        self._ports[0].due_s = 0.001


def test_an_encoder_left_in_continuous_mode_is_stopped_first(tmp_path):
    run = entries_of(tmp_path, device_class=LeftRunning)
    assert not run.missing().any()
    assert run.counters()["stray_bytes"] == 0


def test_wrong_bits_are_reported(tmp_path):
    table = RlsTable(kind="rls", id="wrist", ports=PORTS, bits=18)
    options = {"per_turn": 1 << 18, "ports": PORTS, "bits": 17, "rate_hz": 70.0}
    run = told_by(RlsDriver, table, tmp_path, PORTS, **options)
    assert run.missing().mean() > 0.3
    faults = [f for f in run.of(DeviceFault) if f.code == "readings_missing"]
    assert all("bits" in fault.remedy for fault in faults)
    assert faults


@pytest.mark.parametrize(
    "bad",
    [
        {"ports": ()},
        {"ports": ("a", "a")},
        {"ports": ("a",), "bits": 23},
        {"ports": ("a",), "mode": "spi"},
        {"ports": ("a",), "period_us": 100},
    ],
)
def test_options_are_strict(bad):
    with pytest.raises(ValidationError):
        RlsOptions(**bad)


class CountedUp(CountsUp, SimulatedRls):
    """Replies with a reading are lost on demand."""

    reading = b"d"


class RlsRig(PeerRig):
    def __init__(self, folder) -> None:
        table = RlsTable(kind="rls", id="wrist", ports=PORTS)
        mounting = mounted(folder, table, per_turn=16384)
        peer = SimulatedPeer(folder / "a", lambda: CountedUp(table, mounting), mounting)
        ports = tuple(str(folder / port) for port in PORTS)
        super().__init__(peer, RlsDriver, ports=ports, answer_timeout_s=0.25)

    def lose(self, n):
        self.peer.device.to_lose = [1, n - 1]


rig = rig_fixture(RlsRig)


class TestContract(DriverContract, StreamContract):
    rate_hz = 200.0
    parts = (1, 7, 40)
