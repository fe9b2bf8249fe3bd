"""The crash test's judge finds what was lost, invented, doubled or out of order."""

import json
import shutil
import sqlite3
from contextlib import closing

import pytest

from benchmarks.soak.consumer import Store
from benchmarks.soak.judge import Span, judge
from benchmarks.tools.rig import ARM
from tests.protocol.message_examples import POINT
from traverse.protocol.encoding import encode

SPAN = Span(begun_s=100.0, ended_s=110.0, starts=2)


def point(session, seq, trigger="button"):
    counts = (1000 + seq, 2, 3, 4, 5, 6, ord(session))
    changed = {"session": session, "seq": seq, "id": f"{session}-{seq}"}
    changed |= {"counts": counts, "trigger": trigger}
    return POINT.model_copy(update=changed)


class Run:
    """What a crash test of two sessions leaves behind, sound until it is changed."""

    def __init__(self, folder):
        self.folder = folder
        self.held = [point("a", n) for n in range(8)]
        self.held += [point("b", n) for n in range(6)]
        self.held.append(point("b", 6, "command"))
        self.received = list(self.held)
        self.pressed = [one for one in self.held if one.trigger == "button"]
        self.told = ["b-6"]
        self.figures = {
            "resend_requested": 2,
            "duplicates": 1,
            "lost": 0,
            "connections": 3,
        }
        self.pace_s = 0.7
        self.notes = []

    def judge(self):
        shutil.copy(ARM, self.folder / "arm.toml")
        with closing(Store(self.folder / "store.db")) as store:
            store.put(self.received, self.figures)
        outbox = self.folder / "outbox.db"
        with closing(sqlite3.connect(outbox)) as database, database:
            database.execute("CREATE TABLE messages (number INTEGER, payload BLOB)")
            rows = [(n, encode(one, "json")) for n, one in enumerate(self.held)]
            database.executemany("INSERT INTO messages VALUES (?, ?)", rows)
        told = [{"ok": True, "id": one} for one in self.told]
        self._write("operator.jsonl", [*told, {"ok": False, "code": "none"}])
        times_s = [100.0 + self.pace_s * n for n in range(len(self.pressed))]
        edges = [
            {"time_s": time_s, "life": "0", "seq": n, "sent_s": time_s - 0.5}
            for n, time_s in enumerate(times_s)
        ]
        self._write("acknowledged.jsonl", [*edges, *self.notes])
        presses = [
            {"event": "edge", "level": 1, "seq": n, "counts": one.counts}
            for n, one in enumerate(self.pressed)
        ]
        self._write("truth-0.jsonl", presses)
        return judge(self.folder, outbox, ["0"], SPAN)

    def _write(self, name, lines):
        text = "".join(json.dumps(line) + "\n" for line in lines)
        (self.folder / name).write_text(text)


@pytest.fixture
def run(tmp_path):
    return Run(tmp_path)


def test_sound_run_is_good_and_told_in_figures(run):
    verdict = run.judge()

    assert verdict.faults == []
    assert verdict.figures == {
        "sessions with points": 2,
        "percent of the time measuring": 91,  # 13 pauses of 0.7 s in 10 s
        "commands sent": 2,
        "commands answered": 1,
        "commands without answer": 1,
        "commands refused": 0,
        "commanded points acknowledged": 1,
        "edges acknowledged": 14,
        "points in the outbox": 15,
        "points in the store": 15,
        "points asked for again": 2,
        "duplicates removed": 1,
        "consumer's connections": 3,
        "acknowledged and lost": 0,
        "told as lost": 0,
        "invented": 0,
        "doubled": 0,
        "out of order": 0,
    }


def test_acknowledged_command_that_is_missing_is_a_fault(run):
    run.told.append("b-7")

    verdict = run.judge()

    assert verdict.figures["acknowledged and lost"] == 1
    assert verdict.faults == ["1 acknowledged, but not in the store: ['b-7']"]


def test_acknowledged_press_without_a_point_is_a_fault(run):
    run.pressed.append(point("c", 0))

    verdict = run.judge()

    assert verdict.figures["acknowledged and lost"] == 1
    assert "acknowledged edges without a point" in verdict.faults[0]


@pytest.mark.parametrize(("recovered_s", "n_lost"), [(109.4, 0), (109.2, 1)])
def test_press_that_met_a_failing_disk_promises_no_point(run, recovered_s, n_lost):
    run.pressed.append(point("c", 0))  # sent at 109.3, acknowledged at 109.8 s
    run.notes = [
        {"time_s": 108.0, "disk": False},
        {"time_s": recovered_s, "disk": True},
    ]

    assert run.judge().figures["acknowledged and lost"] == n_lost


def test_point_without_a_press_is_invented(run):
    run.pressed.pop()

    verdict = run.judge()

    assert verdict.figures["invented"] == 1
    assert "invented: no press has these counts" in verdict.faults[0]


def test_points_that_change_places_are_out_of_order(run):
    run.received[2:4] = run.received[3], run.received[2]

    verdict = run.judge()

    assert verdict.figures["out of order"] == 3  # 3 for 2, 2 for 4, 4 for 3
    assert "session a: 3 in the place of 2" in verdict.faults


def test_two_points_of_one_press_are_a_fault(run):
    again = point("b", 7).model_copy(update={"counts": run.held[-2].counts})
    run.held.append(again)
    run.received.append(again)

    verdict = run.judge()

    assert verdict.figures["doubled"] == 1
    assert "two points of one press" in verdict.faults[0]


def test_run_in_which_little_was_measured_fails_though_nothing_was_lost(run):
    run.pace_s = 3.0

    verdict = run.judge()

    assert verdict.figures["percent of the time measuring"] == 0
    [fault] = verdict.faults
    assert "measuring for 0% of 10 s" in fault
