import csv
import io
import json
import logging
from pathlib import Path

import pytest
from rich.console import Console
from typer.testing import CliRunner

import traverse.cli
from tests.cli.test_align import NOMINAL, measured, table
from tests.protocol.message_examples import EVENT, POINT, STATUS
from tests.running import invoke
from traverse.cli.common.message_lines import line
from traverse.cli.points.outbox import point_line, session_line
from traverse.cli.watch.view import picture
from traverse.client.display.arm_state import ArmSight
from traverse.client.exports.text import Csv
from traverse.daemon.clock import HostClock
from traverse.daemon.monitoring.events import EventLog
from traverse.daemon.store.outbox import message_of
from traverse.daemon.store.records import StoredMessage, StoredSession
from traverse.daemon.system.log_setup import JsonLines, PlainLines
from traverse.kinematics.arm_file.arm import read_arm
from traverse.protocol.messages.point import Label
from traverse.simulator.campaigns import (
    CampaignSpec,
    draw_noise,
    make_poses,
    write_campaign,
)

ARM = Path(traverse.cli.__file__).parent / "demo_data" / "arm.toml"
# A formula, a script, and what matplotlib would take for mathematics.
NAME = "=1+<script>alert(1)</script>$\\frac{$"
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
    assert all(line.isprintable() for line in shown.split("\n"))
    assert not any(line.startswith("12:00:00") for line in shown.split("\n"))


@pytest.mark.parametrize("form", [PlainLines, JsonLines])
def test_an_entry_of_the_log_cannot_begin_another(text, form):
    record = logging.makeLogRecord({"msg": "said %s", "args": (text,)})
    first, *following = form().format(record).split("\n")
    assert all(line.isprintable() for line in (first, *following))
    assert all(line.startswith(" ") for line in following)
    if form is JsonLines:
        assert json.loads(first)["message"] == f"said {text}"


def test_an_event_is_printable_where_it_is_made(text):
    occurrences = []
    events = EventLog(HostClock(), occurrences.append)
    events.report("error", "a.b", text, source="s", remedy=text)
    events.change(True, "error", "a.c", text, source="s", remedy=text)
    assert [(o.text.isprintable(), o.remedy.isprintable()) for o in occurrences] == [
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


@pytest.fixture(scope="module")
def hostile_campaign(tmp_path_factory):
    """A campaign whose first artefact has a name that means no good."""
    folder = tmp_path_factory.mktemp("hostile")
    arm = read_arm(ARM)
    poses = make_poses(arm, CampaignSpec(mix="cones+bar", n_poses=60), seed=3)
    write_campaign(folder, draw_noise(poses, 5), arm)
    for file, head, old, new in (
        ("campaign.toml", 'operator = "\\u001b[2J"\n', '"cone-1"', f"'{NAME}'"),
        ("poses.csv", "", ",cone-1,", f",{NAME},"),
    ):
        text = (folder / file).read_text("utf-8").replace(old, new)
        (folder / file).write_text(head + text, "utf-8")
    return folder


@pytest.mark.parametrize(
    ("words", "out"),
    [
        (("predict",), "poses.csv"),
        pytest.param(("identify",), "residuals.csv", marks=pytest.mark.slow),
        pytest.param(
            ("diagnose", "--max-terms", "1"),
            "discrepancies.csv",
            marks=pytest.mark.slow,
        ),
    ],
)
def test_names_of_a_campaign_are_no_formula_and_no_script(
    hostile_campaign, tmp_path, words, out
):
    command, *options = words
    place = tmp_path / out if command == "predict" else tmp_path
    to = [str(hostile_campaign), "--arm", str(ARM), "--out", str(place)]
    invoke(command, *to, *options)
    with (tmp_path / out).open(encoding="utf-8", newline="") as file:
        names = {row["artefact"] for row in csv.DictReader(file)}
    assert f"'{NAME}" in names
    assert NAME not in names
    for page in tmp_path.glob("*.html"):
        assert_harmless(page)


def test_names_of_nominal_places_are_harmless(tmp_path):
    points = "".join(
        f"[[points]]\nname = {json.dumps(NAME if n == 0 else f'P{n}')}\n"
        f"x_mm = {x}\ny_mm = {y}\nz_mm = {z}\n"
        for n, (x, y, z) in enumerate(NOMINAL.tolist())
    )
    nominal = tmp_path / "nominal.toml"
    nominal.write_text(f'schema = "traverse/nominal/1"\n{points}', "utf-8")
    table(tmp_path / "measured.csv", measured())
    text = (tmp_path / "measured.csv").read_text("utf-8")
    (tmp_path / "measured.csv").write_text(text.replace("P0,", f"{NAME},"), "utf-8")
    to = ["--nominal", str(nominal), "--out", str(tmp_path)]
    CliRunner()
    ran = invoke("align", tmp_path / "measured.csv", *to, color=True)
    assert NAME in ran.output
    assert_harmless(tmp_path / "alignment.html")


def assert_harmless(page):
    text = page.read_text("utf-8")
    assert "alert(1)" in text  # the name is there
    assert "<script>alert" not in text
    assert "\x1b" not in text
