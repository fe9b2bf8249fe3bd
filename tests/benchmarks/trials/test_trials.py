import json
from functools import partial

import pytest

from benchmarks.trials.lines import append, stored
from benchmarks.trials.program import chosen_seeds
from benchmarks.trials.series import Series, executed
from tests.benchmarks.trials.coins import COINS, DEADLY, count, series, thrown
from traverse.fleet.workers import Workers

ONE = Workers(processes=1)


def ran(path, *options):
    return COINS.main(["--out", str(path), "--processes", "1", *options])


def keys(lines):
    return [(line["scenario"], line["seed"]) for line in lines]


def chosen(**options):
    defaults = {"runs": None, "seeds": None, "seed": 0, "scenarios": []}
    counts = chosen_seeds(series(), type("Asked", (), {**defaults, **options}))
    return [(each.scenario, list(seeds)) for each, seeds in counts]


@pytest.mark.parametrize(
    ("options", "fair", "loaded"),
    [
        ({}, range(6), [100, 101]),
        ({"runs": 4}, range(3), [100]),
        ({"runs": 1}, [0], [100]),
        ({"seeds": 1}, [0], [100]),
        ({"seeds": 1, "seed": 3}, [3], [103]),
    ],
)
def test_seeds_are_shared_among_the_scenarios(options, fair, loaded):
    assert chosen(**options) == [("fair", list(fair)), ("loaded", list(loaded))]


def test_scenarios_are_chosen_by_parts_of_their_names():
    assert [name for name, _ in chosen(scenarios=["oad"])] == ["loaded"]


def test_seeds_that_share_their_preparation_stay_together():
    coin = Series("coin", int, count, batch=10)
    batches = [seeds for _, seeds in coin.batches([8, 9, 10, 11, 25])]
    assert batches == [(8, 9), (10, 11), (25,)]


def test_outcomes_are_written_and_a_later_run_continues(tmp_path, capsys):
    path = tmp_path / "build" / "coins.jsonl"
    assert ran(path, "--seeds", "1") == 0
    assert sorted(keys(stored(path))) == [("fair", 0), ("loaded", 100)]
    assert "0 trials; 2 to go" in capsys.readouterr().out
    assert ran(path) == 0
    assert "2 trials; 6 to go" in capsys.readouterr().out
    lines = stored(path)
    assert len(lines) == len(set(keys(lines))) == 8
    unshared = series()[0].trial(4)
    (of_worker,) = [line for line in lines if line["seed"] == 4]
    assert of_worker["outcome"] == unshared["outcome"]
    assert unshared["outcome"]["nothing"] is None
    first = path.read_bytes()
    assert ran(path) == 0
    assert "8 trials; 0 to go" in capsys.readouterr().out
    assert path.read_bytes() == first


def test_without_minutes_nothing_is_run(tmp_path, capsys):
    assert ran(tmp_path / "coins.jsonl", "--minutes", "0") == 0
    assert "heads: {}" in capsys.readouterr().out


def test_trials_of_other_code_do_not_count(tmp_path, capsys):
    path = tmp_path / "coins.jsonl"
    ran(path, "--seeds", "1")
    old = [{**line, "code": "other"} for line in stored(path)]
    path.unlink()
    append(path, old)
    capsys.readouterr()
    ran(path, "--minutes", "0", "--any-code")
    assert "2 trials; 6 to go" in capsys.readouterr().out
    ran(path, "--minutes", "0")
    printed = capsys.readouterr().out
    assert "2 trials were made by other code and do not count" in printed
    assert "0 trials; 8 to go" in printed


def test_a_trial_that_breaks_is_an_outcome_and_fails_the_run(tmp_path, capsys):
    path = tmp_path / "coins.jsonl"
    assert ran(path, "--seed", "6", "--scenarios", "fair", "--seeds", "2") == 1
    printed = capsys.readouterr().out
    assert "broke: fair, seed 7: is on its edge" in printed
    assert "2 trials, 1 broke" in printed
    broken = [line for line in stored(path) if line["error"]]
    assert "ValueError: this coin" in broken[0]["error"]


def test_a_trial_that_kills_its_workers_is_an_outcome_too():
    coin = Series("coin", partial(thrown, 0.5), count)
    batches = executed(ONE, [(coin, [DEADLY, DEADLY + 1])])
    lines = {line["seed"]: line for batch in batches for line in batch}
    assert "workers died" in lines[DEADLY]["error"]
    assert lines[DEADLY + 1]["error"] is None


def test_what_does_not_hold_is_the_status(tmp_path):
    path = tmp_path / "coins.jsonl"
    ran(path)
    lines = [
        {**line, "outcome": {"heads": 9 if line["scenario"] == "fair" else 1}}
        for line in stored(path)
    ]
    path.unlink()
    append(path, lines)
    assert ran(path) == 1


def test_a_cluster_that_is_not_there_is_said(tmp_path, capsys):
    out = str(tmp_path / "coins.jsonl")
    assert COINS.main(["--out", out, "--scheduler", "nowhere"]) == 2
    assert "expected one such as tcp://host:8786" in capsys.readouterr().out


def test_half_a_line_is_made_again(tmp_path):
    path = tmp_path / "coins.jsonl"
    append(path, [{"scenario": "fair", "seed": 0}])
    with path.open("a") as file:
        file.write('{"scenario": "fair')
    assert len(stored(path)) == 1
    append(path, [{"scenario": "fair", "seed": 1}])
    assert [line["seed"] for line in stored(path)] == [0, 1]
    assert all(json.loads(text) for text in path.read_text().splitlines())
