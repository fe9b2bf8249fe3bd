import json

import pytest
from typer.testing import CliRunner

from tests.drivers.amt21.fake_encoders import FakeEncoder, FakeLine, PtyEncoders
from tests.running import invoke

runner = CliRunner()
PATIENCE = ("--timeout", "0.2")  # a busy machine answers late


@pytest.fixture(params=[False, True], ids=["no echo", "echo"])
def encoders(request, tmp_path):
    line = FakeLine(0x54, 0x60, echo=request.param)
    line.encoders[0x54] = FakeEncoder(count=1234)
    line.encoders[0x60] = FakeEncoder(count=-2 * 16384 + 77)
    made = PtyEncoders(line, tmp_path / "line")
    made.plug()
    yield made
    made.unplug()


def run_amt21(encoders, *arguments, status=0, **options):
    port = ["--port", str(encoders.link)]
    return invoke("amt21", *arguments, *port, **options, status=status)


def test_a_scan_lists_who_answers(encoders, monkeypatch):
    # Each silent address costs its time.
    monkeypatch.setattr("traverse.cli.devices.amt21.ADDRESSES", (0x54, 0x58, 0x60))
    ran = run_amt21(encoders, "scan", "--json", *PATIENCE)
    report = json.loads(ran.output)
    assert report["echo"] is encoders.line.echo
    assert report["encoders"] == [
        {"address": 0x54, "position": 1234, "turns": 0},
        {"address": 0x60, "position": 77, "turns": -2},
    ]
    assert {byte & 3 for byte in encoders.line.heard} == {0, 1}


@pytest.mark.parametrize(("name", "code"), [("zero", "5E"), ("reset", "75")])
def test_maintenance_is_requested_before_it_is_done(encoders, name, code):
    ran = run_amt21(
        encoders, name, "--address", "0x54", *PATIENCE, input="n\n", status=1
    )
    assert "is at 1234" in ran.output
    assert 0x56 not in encoders.line.heard
    ran = run_amt21(encoders, name, "--address", "84", "--yes", "--json", *PATIENCE)
    report = json.loads(ran.stdout)
    assert (report["address"], report["before"]) == (84, 1234)
    assert bytes.fromhex(f"56 {code}") in encoders.line.heard


def test_what_is_no_address_is_refused(encoders):
    ran = run_amt21(encoders, "zero", "--address", "0x55", status=2)
    assert "multiple of 4" in ran.output
    assert encoders.line.heard == b""


def test_an_address_where_nobody_is_cannot_be_reached(encoders):
    ran = run_amt21(
        encoders, "reset", "--address", "0x40", "--yes", "--timeout", "0.1", status=3
    )
    assert "nothing answers" in ran.output
    assert 0x42 not in encoders.line.heard


def test_a_port_that_is_not_there_is_reported(tmp_path):
    ran = invoke("amt21", "scan", "--port", tmp_path / "none", status=3)
    assert "no such port" in ran.output
