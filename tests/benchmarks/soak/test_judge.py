"""The crash test's judge finds lost, invented, doubled and misordered messages.

The crash test judges itself: a daemon that was down has shown nothing.
The crash test's tap: what it follows is the board and nothing else.
"""

import io
import json
import os
import shutil
import sqlite3
import threading
from contextlib import closing
from pathlib import Path

import pytest

from benchmarks.soak.consumer import Store
from benchmarks.soak.judge import Span, Work, judge, measuring_s
from benchmarks.soak.tap import Mark, follow
from benchmarks.tools.rig import ARM, wait_for
from tests.protocol.message_examples import POINT
from traverse.protocol.encoding import encode

SPAN = Span(begun_s=100.0, ended_s=110.0, starts=2)


def point(session, seq, trigger="button"):
    counts = (1000 + seq, 2, 3, 4, 5, 6, ord(session))
    changed = {"session": session, "seq": seq, "id": f"{session}-{seq}"}
    changed |= {"counts": counts, "trigger": trigger}
    return POINT.model_copy(update=changed)


class Run:
    """Files of a crash test of two sessions, sound until they are changed."""

    def __init__(self, folder):
        self.folder = folder
        self.held = [point("a", n) for n in range(8)]
        self.held += [point("b", n) for n in range(6)]
        self.held.append(point("b", 6, "command"))
        self.received = list(self.held)
        self.pressed = [pressed for pressed in self.held if pressed.trigger == "button"]
        self.answered = ["b-6"]
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
            rows = [(n, encode(pressed, "json")) for n, pressed in enumerate(self.held)]
            database.executemany("INSERT INTO messages VALUES (?, ?)", rows)
        replies = [{"ok": True, "id": request_id} for request_id in self.answered]
        self._write("operator.jsonl", [*replies, {"ok": False, "code": "none"}])
        times_s = [100.0 + self.pace_s * n for n in range(len(self.pressed))]
        edges = [
            {"time_s": time_s, "life": "0", "seq": n, "sent_s": time_s - 0.5}
            for n, time_s in enumerate(times_s)
        ]
        self._write("acknowledged.jsonl", [*edges, *self.notes])
        presses = [
            {"event": "edge", "level": 1, "seq": n, "counts": pressed.counts}
            for n, pressed in enumerate(self.pressed)
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
        "reported as lost": 0,
        "invented": 0,
        "doubled": 0,
        "out of order": 0,
    }


def test_acknowledged_command_that_is_missing_is_a_fault(run):
    run.answered.append("b-7")

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
    repeated = point("b", 7).model_copy(update={"counts": run.held[-2].counts})
    run.held.append(repeated)
    run.received.append(repeated)

    verdict = run.judge()

    assert verdict.figures["doubled"] == 1
    assert "two points of one press" in verdict.faults[0]


def test_run_in_which_little_was_measured_fails_though_nothing_was_lost(run):
    run.pace_s = 3.0

    verdict = run.judge()

    assert verdict.figures["percent of the time measuring"] == 0
    [fault] = verdict.faults
    assert "measuring for 0% of 10 s" in fault


def work(*, measuring_s=80.0, starts=10, sessions=9):
    return Work(
        seconds=100.0, measuring_s=measuring_s, starts=starts, sessions=sessions
    )


def test_run_of_a_daemon_at_work_is_good():
    assert work().share == 0.8
    assert work().faults() == []


def test_run_of_a_daemon_that_rarely_measured_has_shown_nothing():
    [fault] = work(measuring_s=13.0).faults()

    assert "measuring for 13% of 100 s" in fault
    assert "daemon.log" in fault


def test_run_whose_starts_led_nowhere_has_shown_nothing():
    [fault] = work(starts=229, sessions=7).faults()

    assert "7 sessions with points in 229 starts" in fault


@pytest.mark.parametrize(("sessions", "n_faults"), [(4, 1), (5, 0)])
def test_half_of_the_starts_are_enough(sessions, n_faults):
    assert len(work(sessions=sessions).faults()) == n_faults


def test_run_of_no_length_has_shown_nothing():
    assert Work(0.0, 0.0, starts=0, sessions=0).share == 0.0


@pytest.mark.parametrize(
    ("times_s", "expected_s"),
    [
        ([], 0.0),
        ([20.0], 0.0),
        ([20.0, 20.5, 21.5], 1.5),
        ([20.0, 21.0, 30.0, 31.0], 2.0),  # nine seconds without
        ([5.0, 9.9, 10.2, 11.2, 99.9, 100.1], 1.0),  # before and after do not count
    ],
)
def test_time_of_measuring_is_that_of_acknowledgements_without_pauses(
    times_s, expected_s
):
    assert measuring_s(times_s, 10.0, 100.0) == pytest.approx(expected_s)


def test_link_of_another_board_has_another_mark_though_it_leads_to_the_same(
    tmp_path: Path,
):
    link = tmp_path / "board.pty"
    assert Mark.of(link) is None
    link.symlink_to("/dev/pts/999")
    first = Mark.of(link)
    assert first is not None
    assert first.target == "/dev/pts/999"
    assert Mark.of(link) == first

    os.utime(link, ns=(1, 1), follow_symlinks=False)

    assert Mark.of(link) != first


def test_tap_lets_go_of_a_pty_that_is_not_the_board_any_more(tmp_path: Path):
    ours, line = os.openpty()  # of a stranger, who never hangs up
    link, host = tmp_path / "board.pty", tmp_path / "line.pty"
    link.symlink_to(os.ttyname(line))
    (tmp_path / "life").write_text("0")
    mark = Mark.of(link)
    assert mark is not None
    log = io.StringIO()
    tap = threading.Thread(target=follow, args=(link, mark, host, log), daemon=True)
    tap.start()
    wait_for(host.is_symlink, "a line for the daemon")

    fresh = tmp_path / "fresh"
    fresh.symlink_to(os.ttyname(line))
    os.utime(fresh, ns=(1, 1), follow_symlinks=False)
    fresh.replace(link)  # by the board, which is back

    tap.join(20.0)
    assert not tap.is_alive()
    assert not host.is_symlink()
    assert link.is_symlink()
    os.close(ours)
    os.close(line)
