"""The table of the blind test, and the file of its runs."""

import json

import pytest

from benchmarks.blind.__main__ import main
from benchmarks.blind.outcomes import FULL, QUICK, SCENARIOS, append, missing, stored
from benchmarks.blind.table import rows

GOOD = {
    "detected": True,
    "exact": True,
    "right_joint": True,
    "in_set": True,
    "single": True,
    "unknown": False,
    "confident_wrong": False,
    "all_exact": True,
    "deviations": [0.5, -1.0, 2.5],
}
RIVAL = {"detected": True, "exact": False, "all_exact": False}
BASELINES = ("overall test", "raw correlation", "forward BIC", "sparse regression")


def line(scenario, seed, gap=None, **changes):
    return {
        "scenario": scenario,
        "seed": seed,
        "error": None,
        "hidden": [{"identity": ["backlash", "J1", None, None, None]}],
        "score": {**GOOD, **changes},
        "gap": gap,
        "seconds": 1.0,
        "rivals": dict.fromkeys(BASELINES, RIVAL),
    }


def table(lines):
    return {row.what: row for row in rows(lines)}


def test_a_rate_holds_as_long_as_its_interval_reaches_the_figure():
    # 17 of 20: 62.1 to 96.8 % by Clopper and Pearson, as their tables have it.
    lines = [line("one at 6", seed, detected=seed >= 3) for seed in range(20)]
    row = table(lines)["detection at 6"]
    assert row.found == pytest.approx(0.85)
    assert row.interval == pytest.approx((0.621, 0.968), abs=5e-4)
    assert row.holds
    assert not table(lines * 20)["detection at 6"].holds


def test_false_alarms_are_bounded_from_above():
    lines = [line("clean, noise known", seed, detected=seed < 1) for seed in range(100)]
    assert table(lines)["false alarms, noise known"].holds
    many = [line("clean, noise known", s, detected=s < 8) for s in range(100)]
    assert not table(many)["false alarms, noise known"].holds


def test_rivals_stand_beside_where_they_have_an_answer():
    found = table([line("one at 6", 0)])
    assert found["detection at 6"].baselines == (1.0,) * 4
    assert found["exact name at 6"].baselines == (None, 0.0, 0.0, 0.0)
    assert found["right joint at 6"].baselines == (None,) * 4


def test_a_run_that_broke_counts_as_not_found():
    broken = {"scenario": "one at 6", "seed": 1, "error": "ValueError: no"}
    found = table([line("one at 6", 0), broken])
    assert found["detection at 6"].found == pytest.approx(0.5)
    assert found["runs that broke"].found == pytest.approx(0.5)
    assert not found["runs that broke"].holds


def test_blunders_are_compared_seed_by_seed():
    plain = [line("one at 8", seed, exact=seed != 0) for seed in range(10)]
    # One that was wrong anyway, and one that blunders spoil.
    spoilt = [line("one at 8, 5% blunders", seed, exact=seed > 1) for seed in range(10)]
    row = table(plain + spoilt)["exact name at 8 lost by 5% blunders"]
    assert row.found == pytest.approx(0.1)
    assert row.n == 10


def test_gaps_are_pooled():
    gaps = [(11.0, 2.0, 1.0), (1.1, 1.1, 1.0), (2.0, 1.0, 1.0)]
    lines = [line("one at 10", seed, gap=gap) for seed, gap in enumerate(gaps)]
    row = table(lines)["gap closed at 10, pooled against the oracle"]
    assert row.found == pytest.approx(10.0 / 11.1)


def test_numbers_of_parameters_are_counted_one_by_one():
    row = table([line("one at 6", 0), line("two at 6", 0)])[
        "parameters within two sigma"
    ]
    assert row.n == 6
    assert row.found == pytest.approx(4.0 / 6.0)


def test_the_quick_test_is_of_two_hundred_runs_in_all_scenarios():
    assert sum(QUICK.values()) == 200
    assert set(QUICK) == set(FULL) == set(SCENARIOS)
    assert all(FULL[name] > QUICK[name] for name in QUICK)


def test_runs_that_were_made_are_not_made_again(tmp_path):
    path = tmp_path / "runs.jsonl"
    wanted = {"one at 6": 2, "two at 6": 1}
    assert list(missing(stored(path), wanted)) == [
        ("one at 6", 0),
        ("two at 6", 0),
        ("one at 6", 1),
    ]
    append(path, line("one at 6", 0))
    append(path, line("two at 6", 0))
    assert list(missing(stored(path), wanted)) == [("one at 6", 1)]


def test_half_a_line_is_made_again(tmp_path):
    path = tmp_path / "runs.jsonl"
    append(path, line("one at 6", 0))
    with path.open("a") as file:
        file.write('{"scenario": "one at')
    assert len(stored(path)) == 1
    append(path, line("one at 6", 1))
    assert [one["seed"] for one in stored(path)] == [0, 1]
    assert all(json.loads(text) for text in path.read_text().splitlines())


def test_the_table_is_printed_without_making_runs(tmp_path, capsys):
    path = tmp_path / "runs.jsonl"
    append(path, line("one at 6", 0))
    status = main(["--out", str(path), "--scenarios", "one at 6", "--minutes", "0"])
    told = capsys.readouterr().out
    assert "| detection at 6 | >= 95% | 1 |" in told
    assert status == 0
