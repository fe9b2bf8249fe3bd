"""Texts from outside forge no line, move no cursor and are no formula anywhere."""

import csv
import io
import json
import logging

import pytest
from rich.console import Console

from tests.protocol.message_examples import EVENT, POINT, STATUS
from traverse.cli.message_lines import line
from traverse.cli.points.lines import point_line, session_line
from traverse.cli.watch.view import picture
from traverse.client.display.arm_state import ArmSight
from traverse.client.exports.text import Csv
from traverse.daemon.clock import HostClock
from traverse.daemon.monitoring.events import EventLog
from traverse.daemon.store.outbox import message_of
from traverse.daemon.store.records import StoredMessage, StoredSession
from traverse.daemon.system.log_lines import JsonLines, PlainLines
from traverse.protocol.messages.point import Label

TEXTS = (
    "a\n12:00:00 ERROR   forged",
    "a\r12:00:00 ERROR   forged",
    "\x1b[2J\x1b]0;title\x07",
    "\x9b2J",
    "\u202eright to left\u2028line",
    "\udcff",
)


@pytest.fixture(params=TEXTS, ids=ascii)
def text(request):
    return request.param


def test_a_line_of_a_message_is_one_line(text):
    label = Label(artefact=text, feature=text) if text.isascii() else Label()
    for message in (
        EVENT.model_copy(update={"text": text, "remedy": text, "source": text}),
        POINT.model_copy(update={"label": label}),
        STATUS.model_copy(update={"state": text}),
    ):
        assert line(f"arm {text}", message).isprintable()


def test_lists_of_points_are_printable(text):
    label = Label.model_construct(artefact=text, feature=None)
    point = POINT.model_copy(update={"label": label})
    if "\udcff" not in text:  # that cannot be encoded at all
        new = message_of(point, "traverse/a/point", "json", 1, text)
        stored = StoredMessage(
            *(new.session, new.seq, new.id, new.time_ns, new.topic, new.encoding),
            *(new.payload, 1, False),
        )
        assert point_line(stored, as_json=False).isprintable()
    session = StoredSession("s", 0, text, 0, 0)
    assert session_line(session, 1, 0, as_json=False).isprintable()


def test_the_terminal_view_has_no_escape_sequence(text):
    sight = ArmSight(lambda: 5.0)
    sight.take_link(True, "")
    sight.take_status(STATUS)
    sight.take_event(EVENT.model_copy(update={"text": text, "severity": "error"}))
    label = Label.model_construct(artefact=text, feature=None)
    point = POINT.model_copy(update={"label": label, "session": sight.session})
    sight.take_point(point)
    out = io.StringIO()
    console = Console(file=out, width=300, color_system=None)
    console.print(picture("arm", sight))
    shown = out.getvalue()
    assert all(one.isprintable() for one in shown.split("\n"))
    assert not any(one.startswith("12:00:00") for one in shown.split("\n"))


@pytest.mark.parametrize("form", [PlainLines, JsonLines])
def test_an_entry_of_the_log_cannot_begin_another(text, form):
    record = logging.makeLogRecord({"msg": "said %s", "args": (text,)})
    first, *others = form().format(record).split("\n")
    assert all(one.isprintable() for one in (first, *others))
    assert all(one.startswith(" ") for one in others)
    if form is JsonLines:
        assert json.loads(first)["message"] == f"said {text}"


def test_an_event_is_printable_where_it_is_made(text):
    told = []
    events = EventLog(HostClock(), told.append)
    events.report("error", "a.b", text, source="s", remedy=text)
    events.change(True, "error", "a.c", text, source="s", remedy=text)
    assert [(o.text.isprintable(), o.remedy.isprintable()) for o in told] == [
        (True, True)
    ] * 2


@pytest.mark.parametrize(
    ("name", "cell"),
    [
        *((name, f"'{name}") for name in ("=1+1", "+1", "-1", "@SUM(A1)")),
        *((f"{c}=1", ascii(c)[1:-1] + "=1") for c in "\t\r\n\x1b"),
        ("cone-1", "cone-1"),
    ],
)
def test_a_label_is_no_formula_of_a_spreadsheet(name, cell):
    out = io.BytesIO()
    label = Label(artefact=name, feature="cone-1")
    Csv(out).points([POINT.model_copy(update={"label": label})])
    (row,) = csv.DictReader(io.StringIO(out.getvalue().decode(), newline=""))
    assert (row["artefact"], row["feature"]) == (cell, "cone-1")
