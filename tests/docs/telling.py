"""Tutorials that show their commands' output: run, and compared with it."""

import contextlib
import re
import shlex
from pathlib import Path

import pytest

from tests.docs.pages import text_of
from tests.running import invoke, run_program

END_S = 120.0
# Of figures that are shown: other processors round sums otherwise.
TOLERANCE = 0.05
_BLOCK = re.compile(r"^```(?P<language>\w+)\n(?P<text>.*?)^```$", re.DOTALL | re.M)
_NUMBER = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?")
_OURS = ("python ", "traverse ", "sed ")


def blocks(page: str, language: str) -> list[str]:
    matches = _BLOCK.finditer(text_of(page))
    return [match["text"] for match in matches if match["language"] == language]


def printed_blocks(page: str) -> list[tuple[str, list[str]]]:
    """A page's commands after the preparations, each with the lines it shows."""
    printed: list[tuple[str, list[str]]] = []
    for match in _BLOCK.finditer(text_of(page)):
        if match["language"] == "console":
            for line in match["text"].splitlines():
                if line.startswith("$ "):
                    printed.append((line[2:], []))
                elif printed:
                    printed[-1][1].append(line)
        elif match["language"] == "text" and printed:
            printed[-1][1].extend(match["text"].splitlines())
    return [(line, shown) for line, shown in printed if line.startswith(_OURS)]


def output_of(command: str, folder: Path, status: int = 0) -> str:
    """Run a line of a page in a folder, and return its output.

    Commands of ours run here, as their programs do after the imports, which would take
    half of the time.
    """
    words = shlex.split(command)
    with contextlib.chdir(folder):
        if words[0] == "traverse":
            ran = invoke(*words[1:], status=status)
            return ran.stdout
        done = run_program("/bin/sh", "-c", command)
        return done.stdout


def assert_printed(printed: str, shown: list[str], command: str) -> None:
    """Every line that a page shows is among those printed, figures nearly so."""
    lines = printed.splitlines()
    for line in shown:
        same = [
            shown_line for shown_line in lines if words_of(shown_line) == words_of(line)
        ]
        values = [numbers_of(shown_line) for shown_line in same]
        expected = pytest.approx(numbers_of(line), rel=TOLERANCE)
        assert expected in values, f"{command}: not printed: {line}\n{printed}"


def words_of(line: str) -> str:
    return _NUMBER.sub("#", line)


def numbers_of(line: str) -> list[float]:
    return [float(number) for number in _NUMBER.findall(line)]
