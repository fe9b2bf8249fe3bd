"""Some thousands of rounds of every fuzz target; `make fuzz` makes many more."""

import importlib.util
import subprocess
import sys
from pathlib import Path

import pytest

from tests.fuzz.__main__ import NAMES, target

CHECKOUT = Path(__file__).parent.parent.parent
RUNS = 4000


@pytest.mark.parametrize("name", NAMES)
def test_seeds_and_their_beginnings_are_taken(name):
    seeds, check = target(name)
    check(b"")
    for seed in seeds:
        for end in range(min(len(seed), 64)):
            check(seed[:end])
        check(seed)


@pytest.mark.slow
@pytest.mark.skipif(
    importlib.util.find_spec("atheris") is None,
    reason="atheris is not installed: it has no wheel for this Python",
)
def test_no_target_breaks_under_atheris():
    command = [sys.executable, "-m", "tests.fuzz", "--together", f"--runs={RUNS}"]
    done = subprocess.run(
        command, check=False, cwd=CHECKOUT, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr[-4000:]
    assert f"Done {RUNS} runs" in done.stderr


@pytest.mark.slow
@pytest.mark.needs("openssl")
def test_damaged_files_are_refused_in_words():
    # One of every reader; `make fuzz-files` damages all files of all commands.
    names = ["check/daemon", "check/poses", "align/points", "points-list/outbox"]
    names += ["export/recording"]
    command = [sys.executable, "-m", "tests.fuzz.files", *names, "--mutations=1"]
    done = subprocess.run(
        command, check=False, cwd=CHECKOUT, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr[-4000:]
