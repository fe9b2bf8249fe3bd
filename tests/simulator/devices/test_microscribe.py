"""The simulated MicroScribe, spoken to in bytes by hand."""

import os
import termios
from contextlib import contextmanager

import pytest
from pydantic import ValidationError

from tests.simulator.devices.host_side import heard, hosts_of
from tests.simulator.one_hinge import mounted
from traverse.simulator.devices.microscribe.device import (
    MicroscribeTable,
    SimulatedMicroscribe,
)
from traverse.simulator.scenario.script import ScriptEvent

SIGN_ON = (b"\xc5IMMC", b"BEGIN")
GEOMETRY = {
    "alpha": (0, 16384, 0, -16384, 16384, -16384),
    "a": (0, 750, 10250, 750, 0, 0),
    "d": (8250, 0, 0, 9000, 0, 5750),
}


@contextmanager
def arm(folder, *faults, n=6, events=(), **keys):
    table = MicroscribeTable(kind="microscribe", id="ms", port="line", **keys)
    assert list(table.channel_problems((8000,) * n)) == []
    mounting = mounted(
        folder, table, *faults, n_channels=n, per_turn=8000, events=events
    )
    device = SimulatedMicroscribe(table, mounting)
    with hosts_of(device, folder / "line") as (host,):
        device.live(0.0)
        yield device, host, lambda data, at_s=0.0: answer_of(device, host, data, at_s)


def answer_of(device, host, data, at_s):
    os.write(host, data)
    device.live(at_s)
    return heard(host)


def set_speed(host, speed):
    attributes = termios.tcgetattr(host)
    attributes[4] = attributes[5] = speed
    termios.tcsetattr(host, termios.TCSANOW, attributes)


def signed_on(ask):
    assert [ask(data) for data in SIGN_ON] == [b"IMMC", b"IBOX\0"]


def test_sign_on_is_by_call_and_begin(tmp_path):
    with arm(tmp_path) as (_, _, ask):
        assert ask(b"\x03") == b""
        assert ask(b"BEGIN") == b""
        assert ask(b"IM") == b""
        assert ask(b"MC") == b"IMMC"
        assert ask(b"\xc5IMMC") == b"IMMC"  # the host may call again
        assert ask(b"BEGIN") == b"IBOX\0"


def test_packets_are_those_of_the_specification(tmp_path):
    with arm(tmp_path, clock_error_ppm=0.0) as (_, _, ask):
        signed_on(ask)
        # 1000 (t + k) counts at t = 1.234: 1234, 2234 .. 6234
        counts = bytes.fromhex("09 52 11 3A 19 22 21 0A 28 72 30 5A")
        assert ask(b"\x03", 1.234) == b"\x83\x00" + counts
        assert ask(b"\x23", 1.234) == b"\xa3\x00\x09\x52" + counts
        assert ask(b"\x01", 1.234) == b"\x81\x00" + counts[:4]
        assert ask(b"\x00", 1.234) == b"\x80\x00"


def test_hci3_has_eight_encoders(tmp_path):
    with arm(tmp_path, hci=3, n=7) as (_, _, ask):
        signed_on(ask)
        packet = ask(b"\x23", 0.5)
        assert len(packet) == 20
        assert packet[-4:] == bytes.fromhex("32 64 00 00")  # 6500, and none
        assert ask(b"\x02", 0.5) == b"\x82\x00" + packet[4:12]
        maxes = ask(b"\xc6", 0.5)
        assert len(maxes) == 45
        assert maxes[13:17] == (7999).to_bytes(4, "big")


def test_the_arm_says_who_it_is(tmp_path):
    keys = {"geometry": GEOMETRY | {"beta": -3}, "comment": "of 1996", "home": range(6)}
    keys["home"] = tuple(keys["home"])
    with arm(tmp_path, **keys) as (_, _, ask):
        signed_on(ask)
        assert ask(b"\xc8") == b"\xc8MicroScribe 3D\0"
        assert ask(b"\xcb") == b"\xcb10001\0"
        assert ask(b"\xcc") == b"\xccof 1996 Beta\0"
        assert ask(b"\xcd") == b"\xcdFormat DH0.5\0"
        assert ask(b"\xc1") == bytes.fromhex("C1 0000 0001 0002 0003 0004 0005")
        block = ask(b"\xc0")
        assert block[:6] == bytes.fromhex("C0 26 0000 4000")
        assert block[18:20] == bytes.fromhex("28 0A")  # 10.250 in
        assert block[-2:] == b"\xff\xfd"
        assert ask(b"\xc6") == bytes.fromhex("C6 03 3FFF" + "00" * 9 + "1F3F" * 6)


def test_home_puts_the_counts_where_they_belong(tmp_path):
    with arm(tmp_path, home=(100,) * 6) as (_, _, ask):
        signed_on(ask)
        assert ask(b"\xc2", 2.0) == b"\xc2"
        assert ask(b"\x01", 2.0) == bytes.fromhex("81 00 00 64 00 64")


@pytest.mark.parametrize("command", [0xC3, 0xC7, 0xD0, 0xD1])
def test_what_wants_a_password_is_refused(tmp_path, command):
    with arm(tmp_path) as (device, _, ask):
        signed_on(ask)
        assert ask(bytes([command])) == bytes([command])
        assert ask(b"10001\0") == b""
        assert device.totals()["rx_rejected"] == 0
        assert ask(b"\xcb") == b"\xcb10001\0"


def test_other_commands_take_their_arguments(tmp_path):
    with arm(tmp_path, hci=3) as (_, host, ask):
        signed_on(ask)
        assert ask(b"\xd2\x42") == b"\xd2\x42"
        assert ask(b"\xd3\x02") == b"\xd3"
        assert ask(b"\xc4\x0c") == b"\xc4"
        assert ask(b"\xcb") == b""  # it listens at 9600 now
        set_speed(host, termios.B9600)
        assert ask(b"\xcb") == b"\xcb10001\0"


def test_the_arm_follows_the_baud_rate_until_the_session_ends(tmp_path):
    with arm(tmp_path) as (_, host, ask):
        set_speed(host, termios.B19200)
        signed_on(ask)
        assert len(ask(b"\x03")) == 14
        set_speed(host, termios.B57600)
        assert ask(b"\x03") == b""
        assert ask(b"\xc5IMMC") == b""
        set_speed(host, termios.B19200)
        assert ask(b"\xc5") == b""
        set_speed(host, termios.B57600)
        signed_on(ask)


def report(delay_ms=10, deltas=(5,) * 6):
    steps = b"".join(delta.to_bytes(2, "big") for delta in deltas)
    return b"\xcf" + delay_ms.to_bytes(2, "big") + b"\x23\x7f" + b"\xff" * 8 + steps


def test_a_report_of_motion_comes_with_motion(tmp_path):
    with arm(tmp_path) as (device, host, ask):
        signed_on(ask)
        assert not device.streaming
        assert ask(report(), 0.0) == b"\xcf"
        assert device.streaming
        device.live(0.1)
        packets = heard(host)
        assert len(packets) == 10 * 16
        assert [packets[16 * k + 4] << 7 | packets[16 * k + 5] for k in range(10)] == [
            10 * (k + 1) for k in range(10)
        ]
        assert ask(b"\x00", 0.105)[:1] == b"\x80"
        device.live(1.0)
        assert heard(host) == b""
        assert ask(report(deltas=(30, *[65535] * 5)), 1.0) == b"\xcf"
        device.live(1.1)
        assert len(heard(host)) == 3 * 16


def test_pedals_are_bits_and_edges_of_the_packet_that_shows_them(tmp_path):
    events = [
        ScriptEvent(0.995, "switch", 1),
        ScriptEvent(1.501, "button", 1),
        ScriptEvent(1.6, "button", 0),
    ]
    with arm(tmp_path, events=events) as (device, _, ask):
        signed_on(ask)
        assert ask(b"\x00", 0.9) == b"\x80\x00"
        assert ask(b"\x00", 1.0) == b"\x80\x02"
        assert ask(b"\x00", 1.55) == b"\x80\x03"
        assert ask(b"\x00", 1.7) == b"\x80\x02"
    edges = device.mounting.notes.edges
    assert [(e.time_s, e.input_number, e.level, e.inputs) for _, _, e in edges] == [
        (1.0, 1, 1, 2),
        (1.55, 0, 1, 3),
        (1.7, 0, 0, 2),
    ]
    assert [seq for _, seq, _ in edges] == [0, 1, 2]
    assert edges[1][2].counts[0] == 1550
    assert [edge.event for *_, edge in edges] == events


def test_the_timer_wraps_at_14_bits(tmp_path):
    with arm(tmp_path, first_ticks=16380) as (_, _, ask):
        signed_on(ask)
        assert ask(b"\x20", 0.0035) == bytes.fromhex("A0 00 7F 7F")
        assert ask(b"\x20", 0.0045) == bytes.fromhex("A0 00 00 00")


def test_a_reset_ends_the_session(tmp_path):
    fault = {"kind": "reset", "at_s": 1.0, "duration_s": 0.5}
    with arm(tmp_path, fault) as (_, _, ask):
        signed_on(ask)
        assert len(ask(b"\x03", 0.9)) == 14
        assert ask(b"\x03", 1.1) == b""
        assert ask(b"\xc5IMMC", 1.2) == b""
        assert ask(b"\x03", 1.6) == b""
        signed_on(lambda data: ask(data, 1.7))
        # Its timer restarted when power returned, about.
        timer = ask(b"\x20", 1.8)
        assert timer[2] << 7 | timer[3] == pytest.approx(300, abs=301)


def test_faults_of_the_line(tmp_path):
    cut = {"kind": "cut", "at_s": 1.0, "duration_s": 1.0, "probability": 1.0}
    late = {"kind": "late", "at_s": 3.0, "duration_s": 1.0, "probability": 1.0}
    with arm(tmp_path, cut, late | {"delay_s": 0.05}) as (device, host, ask):
        signed_on(ask)
        assert len(ask(b"\x03", 0.5)) == 14
        assert len(ask(b"\x03", 1.5)) == 13
        assert ask(b"\x03", 3.5) == b""
        device.live(3.56)
        packet = heard(host)
        assert packet[2] << 7 | packet[3] == 3500
        assert device.totals()["faults"]["cut"] == 1


def test_what_does_not_fit_is_refused():
    with pytest.raises(ValidationError, match="does not fit"):
        MicroscribeTable(
            kind="microscribe",
            id="ms",
            port="line",
            geometry=GEOMETRY | {"a": (40000, 0, 0, 0, 0, 0)},
        )
    table = MicroscribeTable(kind="microscribe", id="ms", port="x", encoder_turns=2)
    problems = dict(table.channel_problems([16385, *[8000] * 6]))
    assert set(problems) == {"hci", "id", "encoder_turns"}
    assert all(problems.values())
