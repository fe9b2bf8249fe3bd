import numpy as np
import pytest
from pydantic import ValidationError

from tests.drivers.simulated_peer import CountsUp, SimulatedPeer
from tests.drivers.virtual_device import told_by
from tests.simulator.one_hinge import mounted
from traverse.drivers.base.values import (
    STATUS_ERROR,
    STATUS_WARNING,
    CountSamples,
    DeviceAlarm,
    DeviceFault,
    DeviceLost,
    DeviceUp,
    StreamStarted,
)
from traverse.drivers.modbus.driver import BUSY_CODE, ModbusDriver, ModbusOptions
from traverse.drivers.modbus.line import ModbusClient
from traverse.simulator.devices.modbus import ModbusTable, SimulatedModbusLine
from traverse.testing.driver_contract import DriverContract, StreamContract
from traverse.testing.pty_peer import PeerRig, rig_fixture

FIELD = {"baud_rate": 115_200, "request_delay_s": 2e-4, "reply_delay_s": 2e-4}
ENCODER = {"counts_per_turn": 65536, "status_register": 8}
MASKS = {"error_mask": 1, "warning_mask": 2}
BOTH = tuple({"address": a, **ENCODER, **MASKS} for a in (1, 2))


def entries_of(folder, *faults, table=None, encoders=BOTH, **options):
    line = ModbusTable(
        kind="modbus", id="m", port="p", addresses=(1, 2), **FIELD, **(table or {})
    )
    return told_by(
        ModbusDriver,
        line,
        folder,
        ["p"],
        *faults,
        **{
            "port": "p",
            "encoders": encoders,
            "baud_rate": 115_200,
            "rate_hz": 50.0,
            **options,
        },
    )


@pytest.mark.parametrize(
    ("table", "keys"),
    [
        ({}, {}),
        ({"word_order": "low"}, {"word_order": "low", "function": 3}),
        ({"words": 1, "position_register": 1}, {"words": 1, "position_register": 1}),
        ({"encoder_turns": 4096}, {"turns": 4096}),
    ],
)
def test_every_map_of_registers_is_read(tmp_path, table, keys):
    encoders = tuple({**encoder, **keys} for encoder in BOTH)
    run = entries_of(tmp_path, table=table, encoders=encoders)
    (up,) = run.of(DeviceUp)
    modulus = 65536 * keys.get("turns", 1)
    assert up.identity.moduli_counts == (modulus,) * 2
    assert up.identity.counts_per_turn == (65536,) * 2
    assert not up.identity.latches
    assert (np.diff(run.joined("seq")) == 1).all()
    assert not run.joined("status").any()
    off = run.joined("counts") - run.counts_at(run.read_ns()) % modulus
    assert np.abs(off).max() <= 1.0
    assert run.of(DeviceFault) == []


def test_a_reading_is_stamped_in_the_middle_of_its_exchange(tmp_path):
    run = entries_of(tmp_path, status_period_s=0.0)
    latched = np.array([reading[2] for reading in run.notes.readings]) * 1e9
    nearest = latched[:, np.newaxis] - run.read_ns().ravel()
    # 8 bytes there and 9 back, 11 bits each, and 0.2 ms in the adapter each way:
    # the latch is after 0.964 ms of 2.023 ms
    expected_ns = 1e9 * (2e-4 + 8 * 11 / 115_200 - (4e-4 + 17 * 11 / 115_200) / 2)
    off = np.abs(nearest - expected_ns).min(axis=0)
    assert off.max() < 1000


def test_the_rate_that_the_line_reaches_is_reported(tmp_path):
    run = entries_of(tmp_path, rate_hz=400.0)
    (started,) = run.of(StreamStarted)
    # two exchanges of 2.023 ms and two silences of 1.75 ms
    assert started.rate_hz == pytest.approx(0.8 / (2 * 3.773e-3), rel=0.01)
    assert [fault.code for fault in run.of(DeviceFault)] == ["rate_limited"]


def test_status_registers_mark_samples_and_are_alarms_that_end(tmp_path):
    faults = (
        {"kind": "status", "channel": 1, "at_s": 1.0, "duration_s": 1.0},
        {"kind": "status", "channel": 0, "at_s": 1.0, "duration_s": 1.0, "bits": 2},
    )
    run = entries_of(tmp_path, *faults, seconds=4.0, status_period_s=0.2)
    assert sorted(run.alarms()) == [
        (0, "encoder_warning", False),
        (0, "encoder_warning", True),
        (1, "encoder_error", False),
        (1, "encoder_error", True),
    ]
    status = run.joined("status")
    assert set(status[:, 0]) == {0, STATUS_WARNING}
    assert set(status[:, 1]) == {0, STATUS_ERROR}
    marked_s = run.read_ns()[status[:, 1] > 0, 1] * 1e-9
    assert 1.0 < marked_s.min() < 1.3
    assert 2.0 < marked_s.max() < 2.3


def test_a_silent_encoder_is_an_alarm_that_ends_and_does_not_stop_the_others(tmp_path):
    silent = {"kind": "silent", "channel": 1, "at_s": 1.0, "duration_s": 1.0}
    run = entries_of(tmp_path, silent, seconds=4.0, answer_timeout_s=0.03)
    assert run.alarms() == [(1, "encoder_missing", True), (1, "encoder_missing", False)]
    assert "encoder 2" in run.of(DeviceAlarm)[0].text
    assert not run.missing()[:, 0].any()
    assert 40 < run.missing()[:, 1].sum() < 90
    assert run.of(DeviceLost) == []


def test_late_replies_never_pass_for_the_next(tmp_path):
    late = {"kind": "late", "channel": 0, "probability": 1.0, "duration_s": 0.02}
    faults = [
        {**late, "at_s": 0.5 + 0.2 * k, "delay_s": 0.02 + 0.002 * k} for k in range(30)
    ]
    run = entries_of(tmp_path, *faults, seconds=7.0, answer_timeout_s=0.03)
    good = ~run.missing()
    off = run.joined("counts") - run.counts_at(run.read_ns()) % 65536
    assert np.abs(off[good]).max() <= 16.0  # half of an exchange that was nearly late
    assert run.missing()[:, 0].sum() >= 15
    assert run.totals["faults"]["late"] >= 20


def test_whatever_the_line_does_to_frames_no_wrong_count_comes_of_it(tmp_path):
    kinds = ("lost", "corrupted", "garbage", "repeated", "check")
    faults = [{"kind": k, "probability": 0.02, "seed": n} for n, k in enumerate(kinds)]
    run = entries_of(tmp_path, *faults, seconds=8.0, answer_timeout_s=0.03)
    good = ~run.missing()
    off = run.joined("counts") - run.counts_at(run.read_ns()) % 65536
    assert np.abs(off[good]).max() <= 1.0
    assert 0.02 < run.missing().mean() < 0.2


def test_registers_that_are_not_there_are_reported_with_a_remedy(tmp_path):
    wrong = {**BOTH[0], "position_register": 77}
    run = entries_of(tmp_path, encoders=(wrong, BOTH[1]), answer_timeout_s=0.03)
    assert run.alarms() == [(0, "encoder_missing", True)]
    assert "position_register" in run.of(DeviceAlarm)[0].remedy
    assert run.counters()["refused"] >= 3


def test_words_in_the_other_order_are_no_counts(tmp_path):
    # The count would be the high word, which is 0: a joint that rests for ever.
    run = entries_of(tmp_path, table={"word_order": "low"})
    lost = run.of(DeviceLost)[0]
    assert "beyond counts_per_turn" in lost.reason
    assert "word_order" in lost.remedy
    assert not run.of(CountSamples)


def test_an_echo_is_skipped(tmp_path):
    run = entries_of(tmp_path, table={"echo": True}, echo=True)
    assert not run.missing().any()


def test_an_echo_that_nobody_expects_is_named(tmp_path):
    run = entries_of(tmp_path, table={"echo": True}, echo=False, answer_timeout_s=0.03)
    lost = run.of(DeviceLost)[0]
    assert "behind our own requests" in lost.reason
    assert "set echo = true" in lost.remedy


def test_an_encoder_that_is_busy_is_not_asked_for_other_registers():
    # Exception 6, as the specification of the application protocol has it.
    port = Written("01 84 06 C3 02")
    client = ModbusClient(
        port, lambda: 0, lambda _s: None, timeout_s=0.1, silence_s=0.0, echo=False
    )
    reply = client.read_input_registers(0, count=2, device_id=1)
    assert reply.exception_code == BUSY_CODE
    assert not client.is_echoed


@pytest.mark.parametrize(
    "bad",
    [
        {"encoders": ()},
        {"encoders": (BOTH[0], BOTH[0])},
        {"encoders": ({**BOTH[0], "address": 0},)},
        {"encoders": ({**BOTH[0], "counts_per_turn": 2**20, "turns": 2**13},)},
        {"encoders": ({"address": 1, "counts_per_turn": 8, "error_mask": 1},)},
        {"encoders": (BOTH[0],), "parity": "mark"},
    ],
)
def test_options_are_strict(bad):
    with pytest.raises(ValidationError):
        ModbusOptions(port="p", **bad)


class Written:
    """A port that keeps written bytes and answers from a list."""

    def __init__(self, *replies):
        self.written = []
        self.replies = [bytes.fromhex(reply) for reply in replies]

    def wait(self, seconds):
        return bool(seconds and self.replies)

    def read(self):
        return self.replies.pop(0)

    def write(self, data):
        self.written.append(data.hex(" ").upper())


@pytest.mark.parametrize("cut", range(1, 9))
def test_frames_are_those_of_manuals_however_they_are_cut(cut):
    reply = "01 04 04 00 01 E2 40 E3 14"
    port = Written(reply[: 3 * cut], reply[3 * cut :])
    client = ModbusClient(
        port, lambda: 0, lambda _s: None, timeout_s=0.1, silence_s=0.0, echo=False
    )
    response = client.read_input_registers(0, count=2, device_id=1)
    assert response.registers == [0x0001, 0xE240]
    assert port.written == ["01 04 00 00 00 02 71 CB"]


class CountedUp(CountsUp, SimulatedModbusLine):
    """Replies with a reading are lost on demand."""


class ModbusRig(PeerRig):
    def __init__(self, folder) -> None:
        table = ModbusTable(kind="modbus", id="m", port="p", addresses=(1, 2))
        mounting = mounted(folder, table)
        super().__init__(
            SimulatedPeer(folder / "p", lambda: CountedUp(table, mounting), mounting),
            ModbusDriver,
            encoders=BOTH,
            baud_rate=115_200,
            parity="none",
            status_period_s=0.0,
            answer_timeout_s=0.25,
        )

    def lose(self, n):
        self.peer.device.to_lose[0] = n


rig = rig_fixture(ModbusRig)


class TestContract(DriverContract, StreamContract):
    rate_hz = 100.0
    parts = (1, 7, 20)
