"""Figures of a run beside the last release's: worse ones are reported."""

import json
import sys
from dataclasses import replace

import pytest

from benchmarks.tools.compare import (
    STORED,
    Figure,
    headlines,
    machine,
    not_comparable,
    report,
)
from tests.docs.pages import CHECKOUT
from tests.running import run_program


def written(folder, *, point_us=2000.0, ours_s=1e-6):
    """A run with one table, one rate of points and one stream."""
    benchmarks = [
        {
            "metadata": {"table": "one pose", "who": measured, "peer": peer},
            "runs": [{"values": [seconds, 1.1 * seconds, 0.9 * seconds]}],
        }
        for measured, peer, seconds in (
            ("ours", 0, ours_s),
            ("slower", 0, 9e-6),
            ("theirs", 1, 4e-6),
            ("others", 1, 7e-6),
        )
    ]
    (folder / "kinematics.json").write_text(json.dumps({"benchmarks": benchmarks}))
    (folder / "path.json").write_text(json.dumps({"benchmarks": benchmarks[:2]}))
    turns = [
        {
            "program": program,
            "rate_hz": 100.0,
            "cpu_us": 1500.0 * part,
            "latency": {"p50_us": p50_us * part, "p99_us": 3 * p50_us * part},
        }
        for part in (0.97, 1.0, 1.02)
        for program, p50_us in (("plain script", 200.0 / part), ("Traverse", point_us))
    ]
    (folder / "presses.json").write_text(json.dumps({"turns": turns}))
    stream = {
        "rate_hz": 1e3,
        "daemon_share": 0.06,
        "simulator_share": 0.03,
        "ready_s": 0.7,
        "memory_mb": 75.0,
    }
    bare = {"bare_start_s": 0.1, "bare_memory_mb": 30.0}
    idle = [
        {"moves": moves, "daemon_share": share, "board_share": 0.01}
        for moves, share in ((False, 0.015), (True, 0.03))
    ]
    streams = {**bare, "streams": [stream] * 3, "idle": idle * 3}
    (folder / "streams.json").write_text(json.dumps(streams))
    return folder


def test_figures_are_ratios_to_peers_of_the_same_run(tmp_path):
    figures = headlines(written(tmp_path))
    assert {name: round(figure.median, 6) for name, figure in figures.items()} == {
        "one pose: times faster": 4.0,
        "100 presses/s, CPU a point: times": 1.0,
        "100 presses/s, p50: times": 10.0,
        "100 presses/s, p99: times": 10.0,
        "1000 Hz: times the CPU": 2.0,
        "idle, the arm rests: times the CPU": 1.5,
        "idle, the arm moves: times the CPU": 3.0,
        "start: times as long": 7.0,
        "memory: times as much": 2.5,
    }
    assert figures["one pose: times faster"].peer == "theirs"


def test_what_got_worse_is_said_and_nothing_else(tmp_path):
    before = headlines(written(tmp_path))
    lines, n_worse = report(headlines(written(tmp_path)), before)
    assert (n_worse, [line for line in lines if "WORSE" in line]) == (0, [])
    now = headlines(written(tmp_path, point_us=2600.0, ours_s=1.5e-6))
    lines, n_worse = report(now, before)
    worse = [line for line in lines if "WORSE" in line]
    assert n_worse == len(worse) == 3
    assert "p50: times the plain script: 13 (" in worse[0]
    assert "was 10 (" in worse[0]
    back, n_back = report(before, now)
    assert n_back == 0
    assert sum("better: " in line for line in back) == 3


@pytest.mark.parametrize(("part", "is_worse"), [(1.09, False), (1.3, True)])
def test_a_difference_within_the_spread_is_none(part, is_worse):
    before = Figure("peer", 10.0, 8.0, 12.0)
    narrow = Figure("peer", 10.0 * part, 12.1, 13.5)
    assert narrow.is_worse_than(before) is is_worse
    assert not replace(narrow, low=11.9).is_worse_than(before)


def test_a_run_that_is_missing_is_said(tmp_path):
    words = [sys.executable, "-m", "benchmarks.tools.compare", str(tmp_path)]
    ran = run_program(*words, cwd=CHECKOUT, status=2)
    assert "kinematics.json: missing; run make bench first" in ran.stderr
    stored = json.loads(STORED.read_text("utf-8"))["figures"]
    assert all(Figure(**values).median > 0.0 for values in stored.values())


HERE = {"host": "a1", "cpu": "Model 7", "cores": "2", "python": "3.11.2"}


@pytest.mark.parametrize(
    ("kept", "load", "reason"),
    [
        (HERE, 1.0, ""),
        (None, 0.1, "the stored figures name no machine"),
        ({**HERE, "cpu": "Model 8"}, 0.1, "cpu Model 8, here Model 7"),
        ({**HERE, "host": "b2"}, 0.1, "host b2, here a1"),
        (HERE, 4.0, "this machine is busy: load 4.0 a core"),
    ],
)
def test_figures_are_compared_on_one_quiet_machine(kept, load, reason):
    obstacle = not_comparable(HERE, kept, load)
    assert reason in obstacle
    assert bool(obstacle) == bool(reason)


def test_what_is_not_comparable_is_not_worse(tmp_path):
    before = headlines(written(tmp_path))
    now = headlines(written(tmp_path, point_us=2600.0, ours_s=1.5e-6))
    lines, n_worse = report(now, before, "of another machine")
    assert n_worse == 0
    assert sum("not comparable: " in line for line in lines) == len(now)
    # Nor is a ratio to another peer.
    other = {name: replace(figure, peer="new") for name, figure in before.items()}
    assert report(now, other)[1] == 0


@pytest.mark.parametrize(
    ("cpu", "status", "word"),
    [
        ("this", 1, "WORSE: "),
        ("other", 0, "not comparable: they are of another machine"),
    ],
)
def test_only_the_same_machine_gives_a_status(tmp_path, cpu, status, word):
    kept, this_machine = tmp_path / "kept.json", machine()
    compare = [sys.executable, "-m", "benchmarks.tools.compare", str(tmp_path)]
    compare += ["--kept", str(kept)]
    written(tmp_path)
    run_program(*compare, "--keep", cwd=CHECKOUT)
    stored = json.loads(kept.read_text())
    assert stored["machine"] == this_machine
    if cpu == "other":
        stored["machine"]["cpu"] = "another one"
        kept.write_text(json.dumps(stored))
    written(tmp_path, point_us=2600.0)
    # However busy the machine is that runs the tests.
    program = (
        "import sys; from benchmarks.tools import compare\n"
        f"compare._BUSY = 1e9; sys.argv[1:] = {compare[3:]!r}; sys.exit(compare.main())"
    )
    ran = run_program(sys.executable, "-c", program, cwd=CHECKOUT, status=status)
    assert word in ran.stdout
