"""One round of the blind test as a program: its output, files and refusals."""

import json
import os
import subprocess
import sys

import pytest
from click.testing import Result
from typer.testing import CliRunner

from benchmarks.blind.single_round import app
from tests.docs.pages import CHECKOUT
from tests.running import END_S

pytestmark = pytest.mark.slow

PROGRAM = (sys.executable, "-W", "error", "-m", "benchmarks.blind.single_round")


def run_round(*arguments: str) -> Result:
    return CliRunner().invoke(app, arguments, env={"COLUMNS": "200"})


@pytest.fixture(scope="module")
def single_round():
    return subprocess.run(
        [*PROGRAM, "--seed", "3"],
        cwd=CHECKOUT,
        env={**os.environ, "COLUMNS": "200"},
        capture_output=True,
        text=True,
        timeout=END_S,
        check=False,
    )


def test_it_tells_what_was_hidden_last_of_all(single_round):
    assert single_round.returncode == 0, single_round.stderr
    *lines, hidden, score = single_round.stdout.splitlines()
    assert lines
    assert hidden.startswith("hidden: ")
    assert score.startswith("score: ")


def test_nothing_but_the_answer_is_said_when_piped(single_round):
    assert single_round.stderr == ""


def test_nothing_hidden_is_an_answer():
    answer = json.loads(run_round("--seed", "1", "--effects", "0", "--json").stdout)
    assert answer["hidden"] == []
    assert answer["in_words"] in ("right: nothing was hidden", "a false alarm")


def test_json_is_scored_and_a_folder_gets_campaign_truth_and_report(tmp_path):
    words = ("--seed", "5", "--size", "14", "--outside", "--json")
    answer = run_round(*words, "--out", str(tmp_path / "round"))
    assert answer.exit_code == 0, answer.stderr
    printed = json.loads(answer.stdout)
    assert (printed["seed"], printed["size"]) == (5, 14.0)
    assert len(printed["hidden"]) == 1
    assert set(printed["score"]) >= {"exact", "right_joint", "in_set", "n_spurious"}
    assert printed["in_words"]
    written = {
        str(path.relative_to(tmp_path / "round"))
        for path in (tmp_path / "round").rglob("*")
    }
    assert {
        "report.html",
        "diagnosis.json",
        "campaign/campaign.toml",
        "campaign/truth/hidden.json",
    } <= written


def test_a_missing_arm_file_is_refused(tmp_path):
    answer = run_round("--seed", "1", "--arm", str(tmp_path / "none.toml"))
    assert answer.exit_code == 2
    assert "none.toml" in answer.stderr


def test_a_seed_is_needed():
    assert run_round().exit_code == 2
