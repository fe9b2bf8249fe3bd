"""`traverse points` on an outbox beside which no daemon runs.

Outboxes with any damage: reported in a sentence, never as a traceback.
"""

import csv
import io
import json
import random
from dataclasses import replace

import pytest

from tests.daemon.store.test_damage import SESSION, make
from tests.protocol.message_examples import POINT, RETRACTION
from tests.running import invoke
from traverse.daemon.store.database import MessageDatabase
from traverse.daemon.store.outbox import message_of
from traverse.daemon.store.records import NewMessage
from traverse.protocol.messages import Point

NOTES = {"monday": "first shift", "tuesday": ""}


def entry(message: Point, session: str, seq: int, encoding="msgpack") -> NewMessage:
    point = message.model_copy(
        update={"session": session, "seq": seq, "id": f"{session}-{seq}"}
    )
    topic, begun_ns = "traverse/bench-7/point", 1_795_251_247_000_000_000
    return message_of(point, topic, encoding, begun_ns, NOTES[session])


@pytest.fixture
def path(tmp_path):
    """Three messages of monday, two of them sent; two of tuesday, one in JSON."""
    folder = tmp_path / "state"
    folder.mkdir()
    store = MessageDatabase(folder / "outbox.db")
    monday = [entry(POINT, "monday", seq) for seq in range(2)]
    store.add([*monday, entry(RETRACTION, "monday", 2)])
    store.mark_sent([(1, 2)])
    store.add([entry(POINT, "tuesday", 0), entry(POINT, "tuesday", 1, "json")])
    store.close()
    return folder / "outbox.db"


def points(*words, status=0):
    return invoke("points", *words, status=status)


def test_sessions_are_listed_with_what_was_not_sent(path):
    lines = points("list", "--db", path).stdout.splitlines()
    assert [line.split()[0] for line in lines] == ["monday", "tuesday"]
    assert "2026-11-21 08:54:07 UTC  0 to 2, 1 not sent yet  first shift" in lines[0]
    monday, tuesday = map(
        json.loads, points("list", "--db", path, "--json").stdout.splitlines()
    )
    assert monday == {
        "session": "monday",
        "begun_ns": "1795251247000000000",
        "note": "first shift",
        "first_seq": 0,
        "last_seq": 2,
        "points": 3,
        "unsent": 1,
    }
    assert tuesday["unsent"] == 2


def test_the_configuration_tells_where_the_file_is(path, monkeypatch):
    monkeypatch.delenv("STATE_DIRECTORY", raising=False)
    configuration = path.parent.parent / "daemon.toml"
    listing = points("list", "--config", configuration).stdout
    assert listing == points("list", "--db", path).stdout


def test_points_of_a_session_are_listed_in_a_range(path):
    lines = points("list", "--db", path, "--session", "monday").stdout.splitlines()
    assert len(lines) == 3
    assert f"{POINT.xyz_mm[0]:10.4f}" in lines[0]
    assert f"not sent  retracts {RETRACTION.retracts}" in lines[2]
    options = ("--session", "monday", "--from", 1, "--to", 1, "--json")
    (line,) = points("list", "--db", path, *options).stdout.splitlines()
    assert json.loads(line) == {
        "session": "monday",
        "seq": 1,
        "id": "monday-1",
        "time_ns": str(POINT.time_ns),
        "sent": True,
    }


def test_a_table_has_all_that_is_known(path):
    text = points("export", "--db", path).stdout
    rows = list(csv.DictReader(io.StringIO(text)))
    assert [(row["session"], row["seq"]) for row in rows] == [
        ("monday", "0"),
        ("monday", "1"),
        ("monday", "2"),
        ("tuesday", "0"),
        ("tuesday", "1"),
    ]
    first, retraction = rows[0], rows[2]
    assert tuple(float(first[f"{axis}_mm"]) for axis in "xyz") == POINT.xyz_mm
    assert tuple(map(float, first["angles_rad"].split())) == POINT.angles_rad
    assert tuple(map(int, first["counts"].split())) == POINT.counts
    assert int(first["time_ns"]) == POINT.time_ns
    assert first["artefact"] == (POINT.label.artefact or "")
    assert (first["retracts"], retraction["retracts"]) == ("", RETRACTION.retracts)
    assert rows[4] == {**rows[3], "seq": "1", "id": "tuesday-1"}


def test_messages_in_json_are_those_that_were_published(path, tmp_path):
    out = tmp_path / "points.jsonl"
    points("export", "--db", path, "--format", "jsonl", "--out", out)
    messages = [
        Point.model_validate_json(line) for line in out.read_text().splitlines()
    ]
    assert [m.id for m in messages] == [
        *("monday-0", "monday-1", "monday-2", "tuesday-0", "tuesday-1")
    ]
    assert messages[0].xyz_mm == POINT.xyz_mm


def test_what_cannot_be_read_is_named_and_the_rest_is_written(path):
    store = MessageDatabase(path)
    good = entry(POINT, "tuesday", 2)
    store.add([replace(good, payload=b"rubbish")])
    store.close()
    result = points("export", "--db", path, "--session", "tuesday", status=1)
    assert "tuesday-2: cannot be read" in result.stderr
    assert len(result.stdout.splitlines()) == 3
    assert (
        "cannot be read" in points("list", "--db", path, "--session", "tuesday").stdout
    )


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("list",), "one of them"),
        (("list", "--db", "a", "--config", "b"), "one of them"),
        (("list", "--db", "nowhere.db"), "there is no such file"),
        (("list", "--db", "/dev/null"), "is no regular file"),
        (("export", "--db", "{path}", "--format", "xml"), "csv, jsonl"),
        (("export", "--db", "{path}", "--session", "never"), "no points of session"),
        (("export", "--db", "{path}", "--out", "/no/such/folder/x"), "make it first"),
        (
            ("resend", "s", "--arm-name", "a", "--from", "4", "--to", "3"),
            "below --from",
        ),
        (("resend", "s", "--arm-name", "a", "--broker", "ftp://x"), "ftp"),
    ],
)
def test_refusals_say_why(path, words, expected):
    result = points(*(word.format(path=path) for word in words), status=2)
    assert expected in result.stderr


def test_no_broker_is_status_3():
    result = points("resend", "--arm-name", "a", "--broker", "127.0.0.1:9", status=3)
    assert "127.0.0.1:9" in result.stderr


HARMS = {
    "bits": lambda chance, content: [
        flip(chance, content, chance.randrange(len(content)))
        for _ in range(chance.randrange(1, 30))
    ],
    "cut": lambda chance, content: content.__delitem__(
        slice(chance.randrange(len(content)), None)
    ),
    "header": lambda chance, content: flip(chance, content, chance.randrange(2000)),
}


def flip(chance, content, place):
    content[place] ^= 1 << chance.randrange(8)


@pytest.mark.slow
@pytest.mark.parametrize("harm", HARMS)
def test_no_damage_ends_a_command_with_a_traceback(harm, tmp_path):
    good, bad = tmp_path / "good.db", tmp_path / "bad.db"
    make(good)
    out = str(tmp_path / "out.csv")
    for seed in range(8):
        content = bytearray(good.read_bytes())
        HARMS[harm](random.Random(seed), content)
        bad.write_bytes(content)
        for words in (
            ["export", str(bad), "--to", "csv", "--force", "--out", out],
            ["points", "list", "--db", str(bad)],
            ["points", "list", "--db", str(bad), "--session", SESSION],
            ["points", "export", "--db", str(bad), "--out", out, "--force"],
        ):
            done = invoke(*words, status=None)
            assert isinstance(done.exception, SystemExit | None), (seed, words)
            assert done.exit_code in (0, 1, 2), (seed, words)
