"""The worked example of the diagnosis does what its page says."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.docs.pages import CHECKOUT, text_of

PAGE = "docs/tutorial/a-detective-story.md"
END_S = 120.0
# Of figures that are shown: other processors round sums otherwise.
TOLERANCE = 0.05
_BLOCK = re.compile(r"^```(?P<language>\w+)\n(?P<text>.*?)^```$", re.DOTALL | re.M)
_NUMBER = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?")


def blocks(language: str) -> list[str]:
    """All blocks of the page in a language."""
    found = _BLOCK.finditer(text_of(PAGE))
    return [match["text"] for match in found if match["language"] == language]


def told() -> list[tuple[str, list[str]]]:
    """The page's commands after the preparations, each with the lines it shows."""
    found: list[tuple[str, list[str]]] = []
    for match in _BLOCK.finditer(text_of(PAGE)):
        if match["language"] == "console":
            lines = [line[2:] for line in match["text"].splitlines()]
            ours = ("python ", "traverse ", "sed ")
            found += [(line, []) for line in lines if line.startswith(ours)]
        elif match["language"] == "text":
            found[-1][1].extend(match["text"].splitlines())
    return found


def output_of(command: str, folder: Path) -> str:
    """Run a line of the page."""
    python = f"{sys.executable} -m"
    line = command.replace("python -m", python).replace(
        "traverse ", f"{python} traverse ", 1
    )
    ran = subprocess.run(
        ["/bin/sh", "-c", line],
        cwd=folder,
        env={
            "PYTHONPATH": str(CHECKOUT),
            "PATH": "/usr/bin:/bin",
            "OPENBLAS_NUM_THREADS": "1",  # small matrices: more threads only wait
        },
        capture_output=True,
        text=True,
        timeout=END_S,
        check=False,
    )
    assert ran.returncode == 0, ran.stderr
    return ran.stdout


def words_of(line: str) -> str:
    """A line without its numbers."""
    return _NUMBER.sub("#", line)


def numbers_of(line: str) -> list[float]:
    """A line's numbers."""
    return [float(number) for number in _NUMBER.findall(line)]


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_detective_story_happens_as_told(tmp_path: Path) -> None:
    design = CHECKOUT / "traverse" / "demo_data" / "arm.toml"
    shutil.copy(design, tmp_path / "design.toml")
    culprits, monday, tuesday = blocks("toml")
    suspect = design.read_text("utf-8") + "\n" + culprits
    (tmp_path / "suspect.toml").write_text(suspect, "utf-8")
    (tmp_path / "monday.toml").write_text(monday, "utf-8")
    (tmp_path / "tuesday.toml").write_text(tuesday, "utf-8")
    for command, shown in told():
        printed = output_of(command, tmp_path).splitlines()
        for line in shown:
            same = [one for one in printed if words_of(one) == words_of(line)]
            values = [numbers_of(one) for one in same]
            expected = pytest.approx(numbers_of(line), rel=TOLERANCE)
            assert expected in values, f"{command}: not printed: {line}\n{printed}"
    for name in ("conditions", "joints", "term-1", "term-2", "ledger"):
        assert (tmp_path / "found" / f"{name}.png").exists()
