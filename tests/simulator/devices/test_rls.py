"""The simulated RLS encoders, spoken to in bytes by hand."""

import os
from contextlib import contextmanager

import pytest

from tests.simulator.devices.host_side import heard, hosts_of
from tests.simulator.one_hinge import mounted
from traverse.simulator.devices.rls import RlsTable, SimulatedRls


@contextmanager
def encoders(folder, *faults, n=2, **keys):
    ports = tuple(f"uart{number}" for number in range(n))
    table = RlsTable(kind="rls", id="wrist", ports=ports, **keys)
    mounting = mounted(folder, table, *faults, n_channels=n, per_turn=1 << table.bits)
    device = SimulatedRls(table, mounting)
    with hosts_of(device, *(folder / port for port in ports)) as hosts:
        device.live(0.0)
        yield device, hosts


def answer_of(device, host, request, at_s):
    os.write(host, request)
    device.live(at_s)
    return heard(host).hex(" ")


def test_every_request_has_its_answer(tmp_path):
    with encoders(tmp_path) as (device, (first, second)):
        # 1000 counts a second, channel 1 a second ahead: 4642 is 12 22, x4 + 3 is 48 8b
        assert answer_of(device, first, b"1", 4.642) == "31 48 8b"
        assert answer_of(device, second, b"1", 4.642) == "31 58 2b"
        assert answer_of(device, first, b"3", 4.642) == "48 8b"
        assert answer_of(device, first, b"d", 4.642) == "64 48 8b 00"
        assert answer_of(device, first, b"t", 4.642) == "74 48 8b 01 2c"
        assert answer_of(device, first, b"v", 4.642) == "76 30 30 30 37 30 30"
        assert answer_of(device, second, b"i", 4.642) == "69 02"
        assert answer_of(device, first, b"x", 4.642) == ""
        assert device.totals()["rx_rejected"] == 1


def test_more_bits_make_three_bytes(tmp_path):
    with encoders(tmp_path, bits=17) as (device, (first, _)):
        assert answer_of(device, first, b"3", 70.0) == "88 b8 03"


def test_turns_are_signed_and_stand_before_the_position(tmp_path):
    with encoders(tmp_path, encoder_turns=65536) as (device, (first, _)):
        assert answer_of(device, first, b"1", 16.384 * 3) == "31 00 03 00 03"
        assert answer_of(device, first, b"1", 16.384 * 65535) == "31 ff ff 00 03"


def test_status_bits_are_0_when_they_apply(tmp_path):
    faults = (
        {"kind": "status", "channel": 0, "at_s": 1.0, "duration_s": 1.0, "value": 0x40},
        {"kind": "status", "channel": 0, "at_s": 3.0, "duration_s": 1.0, "bits": 2},
    )
    with encoders(tmp_path, *faults) as (device, (first, second)):
        answers = [
            answer_of(device, first, b"d", at_s)[-5:] for at_s in (0.0, 1.0, 2.0, 3.0)
        ]
        assert answers == ["03 00", "a1 40", "43 00", "e2 00"]
        assert answer_of(device, second, b"d", 3.5).endswith("00")


KEY = bytes.fromhex("cd ef 89 ab")


def test_the_continuous_mode_is_set_up_started_and_stopped(tmp_path):
    with encoders(tmp_path) as (device, (first, second)):
        at_s, echo = 0.0, ""
        for byte in KEY + bytes.fromhex("54 00 31 27 10") + KEY + b"S":
            at_s += 0.001
            echo += answer_of(device, first, bytes((byte,)), at_s)
        assert bytes.fromhex(echo) == KEY + b"T\x001\x27\x10" + KEY + b"S"
        started_s = at_s
        assert device.streaming
        assert device.next_due_s(0.0) == pytest.approx(started_s + 0.01)
        device.live(started_s + 0.0301)
        words = heard(first).hex(" ").split(" 31 ")
        assert len(words) == 3
        times_s = [reading[2] - started_s for reading in device.mounting.notes.readings]
        assert times_s == pytest.approx([0.01, 0.02, 0.03])
        assert heard(second) == b""
        at_s += 0.031
        for byte in KEY + b"P":
            at_s += 0.001
            answer_of(device, first, bytes((byte,)), at_s)
        assert not device.streaming
        assert answer_of(device, first, b"1", at_s + 1.0).startswith("31")


def test_settings_sent_too_quickly_are_no_settings(tmp_path):
    with encoders(tmp_path) as (device, (first, _)):
        answer_of(device, first, KEY + b"S", 1.0)
        assert not device.streaming
        assert device.totals()["rx_rejected"] >= 1


def test_an_encoder_that_resets_is_no_more_in_continuous_mode(tmp_path):
    fault = {"kind": "reset", "channel": 0, "at_s": 1.0, "duration_s": 0.5}
    with encoders(tmp_path, fault) as (device, (first, second)):
        for number, byte in enumerate(KEY + b"S"):
            for host in (first, second):
                os.write(host, bytes((byte,)))
            device.live(0.5 + 0.001 * number)
        device.live(2.0)
        lasts = {reading[1]: reading[2] for reading in device.mounting.notes.readings}
        assert lasts[0] < 1.001
        assert lasts[1] > 1.998


@pytest.mark.parametrize(
    ("keys", "per_turn", "where"),
    [
        ({"ports": ("a",)}, [16384, 16384], "ports"),
        ({"ports": ("a", "b")}, [16384, 8192], "bits"),
        ({"ports": ("a", "b"), "encoder_turns": 7}, [16384, 16384], "encoder_turns"),
    ],
)
def test_what_does_not_fit_the_arm_is_told(keys, per_turn, where):
    table = RlsTable(kind="rls", id="wrist", **keys)
    assert [key for key, _ in table.channel_problems(per_turn)] == [where]
