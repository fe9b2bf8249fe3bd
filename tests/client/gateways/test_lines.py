"""Points and scans of an arm as lines: sent, held back, and reported."""

import asyncio
import itertools
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.client.display.values import doubt
from tests.client.virtual_daemon import VirtualDaemon
from tests.protocol.message_examples import POINT, SCAN
from traverse.client import Arm
from traverse.client.cancel_tasks import cancel_tasks
from traverse.client.gateways.lines import LineForm, LineGateway
from traverse.client.gateways.outlets import FileOutlet
from traverse.protocol.messages import Point
from traverse.protocol.messages.quality import Quality
from traverse.testing.waiting import until

pytestmark = pytest.mark.needs("mosquitto")

GOOD = Quality.from_bits(0)


def form(template: str = "pcdmis", undo: str | None = None, **other: Any) -> LineForm:
    chosen = {"coordinates": "centre", "unit": "mm", "decimal": "."} | other
    sends_doubtful = chosen.pop("sends_doubtful", False)
    return LineForm(template, undo, **chosen, sends_doubtful=sends_doubtful)


class Sending:
    def __init__(self, virtual: VirtualDaemon, broker: str, path: Path) -> None:
        self._virtual = virtual
        self._arm = Arm(virtual.arm, broker)
        self._path = path
        self.reports: list[str] = []
        self._n = itertools.count()

    async def send(
        self, points: list[Point], lines: LineForm, doubtful: str = ""
    ) -> LineGateway:
        outlet = FileOutlet(self._path, self.reports.append)
        gateway = LineGateway(lines, outlet, self.reports.append)
        async with self._virtual.running(), outlet, self._arm:
            task = asyncio.create_task(gateway.send_points(self._arm))
            for point in points:
                await self._virtual.publish(self._numbered(point))
            session, n = self._virtual.session, len(points)
            # The place after the last is reached when the one after it is requested.
            await until(lambda: self._arm.cursor.get(session) == n)
            if doubtful:
                await self._virtual.put_in_doubt(doubt(points=doubtful))
                await until(lambda: gateway.counts.doubted > 0)
            await cancel_tasks([task])
        return gateway

    def _numbered(self, point: Point) -> Point:
        seq = next(self._n)
        session = self._virtual.session
        named = {"session": session, "seq": seq, "arm": self._virtual.arm}
        return point.model_copy(update=named)

    @property
    def lines(self) -> str:
        return self._path.read_bytes().decode() if self._path.exists() else ""


@pytest.fixture
def sending(virtual: VirtualDaemon, broker: str, tmp_path: Path) -> Sending:
    return Sending(virtual, broker, tmp_path / "lines.txt")


def good(point_id: str, **other: Any) -> Point:
    return POINT.model_copy(update={"id": point_id, "quality": GOOD, **other})


@pytest.mark.parametrize(
    ("template", "other", "line"),
    [
        ("pcdmis", {}, "612.2500,-80.5000,301.1250\r\n"),
        (
            "mtconnect",
            {},
            "2026-11-21T08:54:07.123456789Z|point_id|a|"
            "point|612.2500 -80.5000 301.1250\n",
        ),
        ("pcdmis", {"unit": "inch"}, "24.1043,-3.1693,11.8553\r\n"),
        ("pcdmis", {"coordinates": "surface"}, "614.0500,-80.5000,298.7250\r\n"),
        ("linuxcnc", {}, "612.250000 -80.500000 301.125000 0 0 0 0 0 0\n"),
        ("spreadsheet", {"decimal": ","}, "0\t612,2500\t-80,5000\t301,1250\tbar\t\r\n"),
        (r"{{{feature}}} {x_mm:+.1f};{z:.1f}\n", {"unit": "inch"}, "{1} +612.2;11.9\n"),
    ],
)
async def test_a_point_is_a_line_of_the_chosen_form(
    template: str, other: dict[str, Any], line: str, sending: Sending
) -> None:
    await sending.send([good("a")], form(template, **other))
    assert sending.lines == line


async def test_a_point_in_doubt_is_sent_where_its_line_says_so_or_it_is_requested(
    sending: Sending,
) -> None:
    assert not POINT.quality.ok
    gateway = await sending.send([POINT, good("b")], form("{seq}\\n"))
    assert sending.lines == "1\n"
    assert gateway.counts.held_back == 1
    flags = ", ".join(POINT.quality.flags)
    assert sending.reports == [f"1 point not sent: point 0 is in doubt ({flags})"]


@pytest.mark.parametrize(
    "lines", [form("{seq} {ok}\\n"), form("{seq} 0\\n", sends_doubtful=True)]
)
async def test_a_point_in_doubt_that_is_sent(lines: LineForm, sending: Sending) -> None:
    await sending.send([POINT], lines)
    assert (sending.lines, sending.reports) == ("0 0\n", [])


async def test_a_point_without_the_chosen_coordinates_is_held_back(
    sending: Sending,
) -> None:
    gateway = await sending.send([good("a")], form(coordinates="part"))
    assert (sending.lines, gateway.counts.held_back) == ("", 1)
    assert "taken without an alignment" in sending.reports[0]


def retraction(of: str, point_id: str) -> Point:
    return POINT.model_copy(update={"id": point_id, "retracts": of, "quality": GOOD})


async def test_a_point_that_was_taken_back_has_a_line_of_its_own_or_is_reported(
    sending: Sending,
) -> None:
    points = [good("a"), POINT, retraction(POINT.id, "c"), retraction("a", "d")]
    gateway = await sending.send(points, form("{seq}\\n", undo="undo {retracts}\\n"))
    assert sending.lines == "0\nundo a\n"  # of what was held back nothing is undone
    assert gateway.counts.undone == 1
    assert sending.reports[1] == f"{POINT.id} was taken back; it was not sent by now"


async def test_so_has_one_that_is_in_doubt_since(sending: Sending) -> None:
    await sending.send([good("a"), good("b")], form("{id}\\n", undo="-{id}\\n"), "b c")
    assert sending.lines == "a\nb\n-b\n"
    assert sending.reports == ["point 1 is in doubt since it was sent (stale)"]


async def test_without_such_a_line_people_are_told(sending: Sending) -> None:
    points = [good("a"), good("c"), retraction("a", "b")]
    await sending.send(points, form("{seq}\\n"), "c")
    assert sending.lines == "0\n1\n"
    assert sending.reports == [
        "a was taken back after it was sent",
        "point 1 is in doubt since it was sent (stale)",
    ]


async def test_names_from_outside_make_no_lines_of_their_own(sending: Sending) -> None:
    label = POINT.label.model_copy(update={"artefact": "bar\n999\x1b[2J"})
    await sending.send([good("a", label=label)], form("{artefact}\\n"))
    assert sending.lines.count("\n") == 1
    assert "\x1b" not in sending.lines


async def test_a_scan_is_a_line_a_point_and_gaps_are_reported(
    virtual: VirtualDaemon, broker: str, tmp_path: Path
) -> None:
    reports: list[str] = []
    path = tmp_path / "lines.txt"
    outlet = FileOutlet(path, reports.append)
    gateway = LineGateway(form("{seq} {x:.2f}\\n"), outlet, reports.append)
    block = SCAN.model_copy(update={"arm": virtual.arm, "last": False, "total": None})
    late = block.model_copy(update={"seq": 1004, "quality": np.zeros(2, np.uint32)})
    async with virtual.running(), outlet, Arm(virtual.arm, broker) as arm:
        task = asyncio.create_task(gateway.send_scans(arm))
        # Scans have quality of service 0: the first may be before the subscription.
        while not path.stat().st_size:
            await virtual.publish(block)
            await asyncio.sleep(0.05)
        await virtual.publish(late)
        await until(lambda: "1005" in path.read_text())
        await cancel_tasks([task])
    assert path.read_text().splitlines()[-2:] == ["1004 612.25", "1005 612.50"]
    assert "1001" not in path.read_text()  # in doubt
    assert "scan scan-3: 2 points lost" in reports
    assert any("1 point not sent: scan scan-3 is in doubt there" in t for t in reports)


@pytest.mark.parametrize(
    ("template", "decimal", "text"),
    [
        ("", ".", "a template of 0 characters"),
        ("{x.__class__}", ".", "is no value of a point"),
        ("{x!r}", ".", "is no value of a point"),
        ("{session:d}", ".", "Unknown format code 'd'"),
        ("{x:.3f},{y:.3f}", ",", "is the decimal sign and stands between values"),
        ("{x", ".", "expected '}'"),
    ],
)
def test_a_template_is_refused_before_anything_is_sent(
    template: str, decimal: str, text: str
) -> None:
    with pytest.raises(ValueError, match=text):
        form(template, decimal=decimal)


async def test_an_arm_that_is_not_heard_of_is_reported_while_no_line_comes(
    virtual: VirtualDaemon, broker: str, tmp_path: Path
) -> None:
    reports: list[str] = []
    outlet = FileOutlet(tmp_path / "lines.txt", reports.append)
    gateway = LineGateway(form(), outlet, reports.append)
    async with outlet, Arm(virtual.arm, broker) as arm:
        task = asyncio.create_task(gateway.send_points(arm))
        async with virtual.running():
            await until(lambda: arm.cursor != {})
            virtual.is_stopped = True
            await until(lambda: len(reports) == 1)
            virtual.is_stopped = False
            await until(lambda: len(reports) == 2)
        await until(lambda: len(reports) == 3)
        await cancel_tasks([task])
    silent, there, offline = reports
    assert "which may be stopped; no line comes" in silent
    assert there == f"{virtual.arm}: it is there"
    assert offline == f"{virtual.arm}: it is offline; no line comes"
