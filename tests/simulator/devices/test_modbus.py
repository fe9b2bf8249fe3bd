"""The simulated Modbus encoders, spoken to in frames out of manuals and by hand."""

import os
from contextlib import contextmanager

import pytest

from tests.simulator.devices.host_side import heard, hosts_of
from tests.simulator.one_hinge import mounted
from traverse.simulator.devices.modbus import ModbusTable, SimulatedModbusLine, crc


def crc_by_definition(data):
    """Bit by bit, as the specification describes it."""
    value = 0xFFFF
    for byte in data:
        value ^= byte
        for _ in range(8):
            odd = value & 1
            value >>= 1
            if odd:
                value ^= 0xA001
    return bytes((value & 0xFF, value >> 8))


def framed(text):
    data = bytes.fromhex(text)
    return data + crc_by_definition(data)


@contextmanager
def encoders(folder, *faults, per_turn=2**20, **keys):
    table = ModbusTable(
        kind="modbus", id="m", port="line", **{"addresses": (1, 2)} | keys
    )
    device = SimulatedModbusLine(
        table, mounted(folder, table, *faults, per_turn=per_turn)
    )
    with hosts_of(device, folder / "line") as (host,):
        device.live(0.0)

        def ask(frame, at_s):
            os.write(host, bytes.fromhex(frame) if isinstance(frame, str) else frame)
            device.live(at_s)
            return heard(host).hex(" ").upper()

        yield device, ask


@pytest.mark.parametrize(
    ("data", "check"),
    [
        ("31 32 33 34 35 36 37 38 39", "37 4B"),  # the usual check value, 4B37
        ("01 04 00 01 00 01", "60 0A"),  # Lika's manual
        ("01 04 02 13 C5", "74 53"),
        ("01 06 00 03 00 01", "B8 0A"),
        ("03 04 00 02 00 02", "D1 E9"),  # Sylvac's
        ("FF 03 00 02 00 04", "F0 17"),
    ],
)
def test_check_sums_are_those_of_manuals(data, check):
    assert crc(bytes.fromhex(data)) == bytes.fromhex(check)
    assert crc_by_definition(bytes.fromhex(data)) == bytes.fromhex(check)


def test_a_position_in_two_registers(tmp_path):
    with encoders(tmp_path) as (_, ask):
        answer = ask("01 04 00 00 00 02 71 CB", 123.456)
        assert answer == "01 04 04 00 01 E2 40 E3 14"
        answer = ask(framed("02 03 00 00 00 02"), 124.0)  # 125000
        assert answer == framed("02 03 04 00 01 E8 48").hex(" ").upper()


def test_a_position_in_one_register_as_in_the_manual(tmp_path):
    keys = {"words": 1, "position_register": 1, "per_turn": 65536}
    with encoders(tmp_path, **keys) as (_, ask):
        assert ask("01 04 00 01 00 01 60 0A", 5.061) == "01 04 02 13 C5 74 53"
        assert ask("01 06 00 03 00 01 B8 0A", 6.0) == "01 06 00 03 00 01 B8 0A"
        assert ask(framed("01 03 00 03 00 01"), 7.0) == "01 03 02 00 01 79 84"


def test_the_low_word_may_come_first(tmp_path):
    with encoders(tmp_path, word_order="low") as (_, ask):
        answer = ask("01 04 00 00 00 02 71 CB", 123.456)
        assert answer == framed("01 04 04 E2 40 00 01").hex(" ").upper()


def test_a_register_that_is_not_there_is_refused(tmp_path):
    with encoders(tmp_path) as (_, ask):
        assert ask(framed("01 04 00 01 00 09"), 1.0) == "01 84 02 C2 C1"
        assert ask(framed("01 2B 00 00 00 00"), 1.0)[:8] == "01 AB 01"
        assert ask(framed("01 03 00 00 00 00"), 1.0)[:8] == "01 83 03"


def test_a_preset_makes_the_present_position_what_is_written(tmp_path):
    with encoders(tmp_path) as (_, ask):
        preset = "01 10 00 00 00 02 04 00 00 00 00 F3 AF"
        assert ask(preset, 100.0) == "01 10 00 00 00 02 41 C8"
        answer = ask("01 04 00 00 00 02 71 CB", 223.456)
        assert answer == "01 04 04 00 01 E2 40 E3 14"


def test_status_bits_and_wrong_check_sums(tmp_path):
    faults = (
        {"kind": "status", "channel": 0, "at_s": 1.0, "duration_s": 1.0},
        {"kind": "status", "channel": 0, "at_s": 1.0, "duration_s": 1.0, "bits": 2},
        {"kind": "check", "channel": 1, "at_s": 1.0, "probability": 1.0},
    )
    with encoders(tmp_path, *faults) as (device, ask):
        status = framed("01 04 00 08 00 01")
        assert ask(status, 0.5)[:14] == "01 04 02 00 00"
        good = ask(framed("02 04 00 00 00 02"), 0.6)
        assert ask(status, 1.5)[:14] == "01 04 02 00 03"
        bad = ask(framed("02 04 00 00 00 02"), 1.6)
        assert framed(good[:-6]).hex(" ").upper() == good
        assert framed(bad[:-6]).hex(" ").upper() != bad
        assert device.totals()["faults"]["check"] == 1


def test_others_and_broken_frames_are_not_answered(tmp_path):
    with encoders(tmp_path) as (device, ask):
        assert ask(framed("07 04 00 00 00 02"), 1.0) == ""
        assert ask("01 04 00 00 00 02 71 CC", 2.0) == ""
        assert ask("01 04 00", 3.0) == ""
        assert ask("01 04 00 00 00 02 71 CB", 3.1) != ""  # silence began it anew
        assert device.totals()["rx_rejected"] == 1


def test_what_does_not_fit_the_arm_is_told():
    table = ModbusTable(kind="modbus", id="m", port="p", addresses=(1,), words=1)
    assert [k for k, _ in table.channel_problems([65536])] == []
    assert [k for k, _ in table.channel_problems([131072])] == ["words"]
    assert [k for k, _ in table.channel_problems([1, 2])] == ["addresses"]
