import itertools
import json
from collections.abc import Iterator

import pytest
from typer.testing import Result

from tests.drivers.canopen.fake_nodes import FakeNodes, u16, u32
from tests.running import invoke

names = itertools.count()


@pytest.fixture
def nodes(caplog: pytest.LogCaptureFixture) -> Iterator[FakeNodes]:
    caplog.set_level("CRITICAL", logger="canopen")
    with FakeNodes(f"command-{next(names)}") as made:
        yield made


def run_can(
    nodes: FakeNodes, *arguments: str, answer: str = "", status: int = 0
) -> Result:
    where = ["--interface", "virtual", "--channel", nodes.channel]
    return invoke(
        "can", *arguments, *where, "--timeout", "0.5", input=answer, status=status
    )


def test_scan_lists_what_is_there(nodes: FakeNodes) -> None:
    nodes.nodes[9].objects |= {(0x6503, 0): u16(1), (0x6505, 0): u16(16)}
    result = run_can(nodes, "scan")
    first, second, last = result.output.splitlines()
    assert first == (
        "node   5: multi-turn encoder, 65536 counts per turn, 4096 turns, position "
        "1000; vendor 5F, product 406, serial number 5"
    )
    assert second.endswith("ALARM: position error; warning: battery low")
    assert last == f"2 nodes on virtual:{nodes.channel}"


def test_scan_reports_as_json(nodes: FakeNodes) -> None:
    nodes.nodes[5].objects[(0x1000, 0)] = u32(0x0001_0191)
    nodes.nodes[9].doubles = True
    result = run_can(nodes, "scan", "--json")
    first, second = json.loads(result.output)["nodes"]
    assert (first["node"], first["profile"], first["vendor"]) == (5, 0x191, None)
    assert "expected an encoder" in first["problem"]
    assert second["answers"] == 2
    assert second["counts_per_turn"] == 65536
    assert second["modulus"] == 65536 * 4096
    assert second["alarms"] == 0
    assert second["problem"] is None


def test_scan_of_an_empty_bus_cannot_reach_anything(nodes: FakeNodes) -> None:
    for node in nodes.nodes.values():
        node.mute = True
    result = run_can(nodes, "scan", status=3)
    assert f"no node answers on virtual:{nodes.channel}" in result.output


def test_a_bus_that_is_not_there_cannot_be_reached() -> None:
    result = invoke(
        "can", "scan", "--interface", "slcan", "--channel", "/dev/no-such", status=3
    )
    assert "cannot open the bus slcan:/dev/no-such" in result.output


def test_a_preset_is_requested_written_and_stored(nodes: FakeNodes) -> None:
    node = nodes.nodes[5]
    node.objects |= {(0x6003, 0): u32(0), (0x1010, 1): u32(1)}
    expected = ("--node", "5", "--value", "4711", "--store")
    result = run_can(nodes, "preset", *expected, "--yes", "--json")
    assert "node 5 is at 1000 of 268435456" in result.stderr
    report = json.loads(result.stdout)
    assert (report["node"], report["before"], report["stored"]) == (5, 1000, True)
    assert node.objects[(0x6003, 0)] == u32(4711)
    assert node.objects[(0x1010, 1)] == b"save"


def test_a_preset_that_is_not_requested_is_not_written(nodes: FakeNodes) -> None:
    node = nodes.nodes[5]
    node.objects[(0x6003, 0)] = u32(7)
    run_can(nodes, "preset", "--node", "5", "--value", "0", answer="n\n", status=1)
    assert node.objects[(0x6003, 0)] == u32(7)


def test_a_preset_beyond_the_range_is_refused(nodes: FakeNodes) -> None:
    result = run_can(
        nodes, "preset", "--node", "5", "--value", str(2**28), "--yes", status=2
    )
    assert "expected 0 to 268435455" in result.output


def test_a_preset_that_the_encoder_refuses_is_reported(nodes: FakeNodes) -> None:
    result = run_can(nodes, "preset", "--node", "5", "--value", "1", "--yes", status=3)
    assert "refused to write object 6003:00: 06020000, no such object" in result.output
