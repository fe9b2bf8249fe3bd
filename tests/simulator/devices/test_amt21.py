"""The simulated AMT21 line, spoken to in bytes by hand."""

import os
from contextlib import contextmanager

import pytest
from pydantic import ValidationError

from tests.simulator.devices.host_side import heard, hosts_of
from tests.simulator.one_hinge import mounted
from traverse.simulator.devices.amt21 import Amt21Table, SimulatedAmt21Line

# 1000 counts a second, channel 1 a second ahead; check bits by hand:
# 4642 = 0x1222 = 01 00 10 00 10 00 10: odd bits 3 ones, even bits 1: 0x1222
# 5642 = 0x160a = 01 01 10 00 00 10 10: odd bits 3 ones, even bits 2: 0x560a
AT_4642, AT_5642 = "22 12", "0a 56"


@contextmanager
def encoders(folder, *faults, n=2, **keys):
    keys = {"addresses": (0x54, 0x58, 0x5C)[:n]} | keys
    table = Amt21Table(kind="amt21", id="line", port="line", **keys)
    mounting = mounted(folder, table, *faults, n_channels=n, per_turn=1 << table.bits)
    device = SimulatedAmt21Line(table, mounting)
    with hosts_of(device, folder / "line") as (host,):
        device.live(0.0)
        yield device, lambda request, at_s: answer_of(device, host, request, at_s)


def answer_of(device, host, request, at_s):
    os.write(host, bytes.fromhex(request))
    device.live(at_s)
    while (due_s := device.next_due_s(0.0)) < float("inf"):
        device.live(due_s)
    return heard(host).hex(" ")


def test_each_encoder_answers_to_its_address_alone(tmp_path):
    with encoders(tmp_path) as (device, ask):
        assert ask("54", 4.642) == AT_4642
        assert ask("58", 4.642) == AT_5642
        assert ask("5c", 4.642) == ""
        assert ask("57", 4.642) == ""  # reserved
        assert device.totals()["rx_rejected"] == 1
        noted = [reading[1:4] for reading in device.mounting.notes.readings]
        assert noted == [(0, 4.642, 4642), (1, 4.642, 5642)]


def test_the_examples_of_the_makers(tmp_path):
    with encoders(tmp_path, n=1) as (_, ask):
        assert ask("54", 8.619) == "ab 61"
        assert ask("54", 16.384) == "00 c0"
        assert ask("54", 16.384 + 16.383) == "ff 3f"
        assert ask("54", 16.384 * 3 + 4.660) == "34 92"


def test_models_of_12_bits_send_four_times_their_value(tmp_path):
    with encoders(tmp_path, n=1, bits=12) as (_, ask):
        assert ask("54", 1.165) == "34 92"  # 1165 x 4 = 0x1234


def test_single_turn_models_have_no_turns(tmp_path):
    with encoders(tmp_path, n=1) as (_, ask):
        assert ask("55", 20.0) == ""


def test_multi_turn_models_count_turns_with_a_sign(tmp_path):
    with encoders(tmp_path, n=1, encoder_turns=16384) as (_, ask):
        assert ask("55", 16.384 * 3 + 1.0) == "03 00"
        assert ask("55", 16.384 * 16383 + 1.0) == "ff 3f"
        assert ask("56 5e", 16.384 * 16384) == ""  # cannot set its zero: continues
        assert ask("54", 16.384 * 16384 + 4.660) == "34 92"


@pytest.mark.parametrize(
    ("command", "at_s", "answer"), [("56 5e", 8.66, "34 92"), ("56 75", 4.642, AT_4642)]
)
def test_zero_and_reset_start_one_encoder_anew(tmp_path, command, at_s, answer):
    with encoders(tmp_path) as (_, ask):
        assert ask(command, 4.0) == ""
        assert ask("54", 4.19) == ""
        assert ask("58", 4.195) == "4b d4"  # 5195: the other continues
        assert ask("54", at_s) == answer


def test_an_unknown_command_does_nothing(tmp_path):
    with encoders(tmp_path) as (device, ask):
        assert ask("56 54", 4.642) == ""
        assert ask("54", 4.642) == AT_4642
        assert device.totals()["rx_rejected"] == 1


def test_faults_strike_single_encoders(tmp_path):
    check = {"kind": "check", "channel": 0, "probability": 1.0, "at_s": 4.0}
    silent = {"kind": "silent", "channel": 1, "at_s": 4.0, "duration_s": 1.0}
    late = {"kind": "late", "channel": 2, "probability": 1.0, "delay_s": 0.05}
    with encoders(tmp_path, check, silent, late, n=3) as (device, ask):
        assert ask("54", 4.642) == "22 52"  # K0 is wrong
        assert ask("58", 4.642) == ""
        assert ask("5c", 4.7) != ""
        counts = device.totals()["faults"]
        assert (counts["check"], counts["silenced"], counts["late"]) == (1, 1, 1)


def test_an_adapter_may_echo(tmp_path):
    with encoders(tmp_path, echo=True, baud_rate=2_000_000) as (_, ask):
        assert ask("54", 4.642 - 5e-6) == f"54 {AT_4642}"
        assert ask("5c", 4.7) == "5c"


@pytest.mark.parametrize("addresses", [(), (0,), (0x55,), (0x54, 0x54), (256,)])
def test_impossible_addresses_are_refused(addresses):
    with pytest.raises(ValidationError):
        Amt21Table(kind="amt21", id="l", port="p", addresses=addresses)


def test_what_does_not_fit_the_arm_file_is_reported_all_at_once():
    table = Amt21Table(
        kind="amt21", id="l", port="p", addresses=(0x54,), encoder_turns=2
    )
    keys = [key for key, _ in table.channel_problems([16384, 4096])]
    assert keys == ["addresses", "bits", "encoder_turns"]
