"""Every command that the documentation shows can be typed, and is run by a test."""

import importlib.util
import re
import shlex
from functools import cache
from pathlib import Path
from typing import Any

import typer.main

from tests.docs.accounts import ELSEWHERE, NOT_RUN, RUN, elsewhere, why_not_run
from tests.docs.pages import CHECKOUT, PAGES, code_words, commands, name_of, tables
from traverse.cli.__main__ import app

CHANGES = CHECKOUT / "CHANGELOG.md"  # describes earlier versions
SHOWN = [(name_of(page), line) for page in PAGES for line in commands(name_of(page))]
SPOKEN = sorted(
    {
        (name_of(page), word)
        for page in PAGES
        if page != CHANGES
        for line in page.read_text("utf-8").splitlines()
        for word in code_words(line)
        if re.match(r"(traverse|make|python -m) [a-z]", word)
    }
)
_INCOMPLETE = ("MissingParameter", "BadOptionUsage")
_PLACEHOLDER = re.compile(r"\.\.\.|[\[\]|<>]|[A-Z]{2,}")


def problem(line: str) -> str | None:
    words = shlex.split(line, comments=True)
    while words and re.fullmatch(r"[A-Z_]+=.*|sudo", words[0]):
        words.pop(0)
    if words[:1] == ["make"]:
        return target_problem(words[1])
    if words[:2] == ["python", "-m"]:
        module_spec = importlib.util.find_spec(words[2])
        return None if module_spec else f"no module {words[2]}"
    return parse_problem(words[1:]) if words[:1] == ["traverse"] else None


def target_problem(target: str) -> str | None:
    text = (CHECKOUT / "Makefile").read_text("utf-8")
    return None if re.search(rf"^{target}:", text, re.M) else f"no target {target}"


@cache
def cli() -> Any:
    return typer.main.get_command(app)


def parse_problem(words: list[str]) -> str | None:
    command = cli()
    while hasattr(command, "commands"):
        name, *rest = words or [""]
        if name not in command.commands:
            # A group may be spoken of, and have an option of its own.
            return None if not words or name[0] == "-" else f"no command {name}"
        command, words = command.commands[name], rest
    try:
        command.make_context("traverse", list(words))
    except Exception as error:  # noqa: BLE001 - the parser's own, of several classes
        return f"{type(error).__name__}: {error}"
    return None


def parts(line: str) -> list[str]:
    quoted = re.sub(r"'[^']*'|\"[^\"]*\"", lambda m: "q" * len(m[0]), line)
    cuts = [m.span() for m in re.finditer(r"&&|;|\||&$", quoted)]
    starts = [0, *(end for _, end in cuts)]
    ends = [*(begin for begin, _ in cuts), len(line)]
    return [line[a:b].strip() for a, b in zip(starts, ends, strict=True) if b > a]


def test_every_command_can_be_typed() -> None:
    faults = {
        (page, part): fault
        for page, line in SHOWN
        for part in parts(line)
        if (fault := problem(part))
    }
    assert faults == {}


def test_every_command_that_is_spoken_of_can_be_typed() -> None:
    # A mention of a command need not have all required arguments.
    faults = {
        (page, word): fault
        for page, word in SPOKEN
        if not _PLACEHOLDER.search(word)
        and (fault := problem(word))
        and not fault.startswith(_INCOMPLETE)
    }
    assert faults == {}


def test_every_command_is_run_by_a_test_or_it_is_told_why_not() -> None:
    unexplained = [
        (page, line)
        for page, line in SHOWN
        if not (page in RUN or elsewhere(page, line) or why_not_run(line))
    ]
    assert unexplained == []


def test_what_runs_them_is_there_and_nothing_is_left_over() -> None:
    for page, test in RUN.items():
        assert commands(page)
        assert Path(page).name in (CHECKOUT / test).read_text("utf-8"), test
    for pattern, test in ELSEWHERE.items():
        assert (CHECKOUT / test).exists()
        assert any(re.match(pattern, line) for _, line in SHOWN), pattern
    for pattern in NOT_RUN:
        assert any(re.match(pattern, line) for _, line in SHOWN), pattern


def test_every_target_of_make_is_explained_and_no_other() -> None:
    text = (CHECKOUT / "Makefile").read_text("utf-8")
    (targets,) = re.findall(r"^\.PHONY: (.*)$", text, re.M)
    assert set(re.findall(r"^([a-z-]+):", text, re.M)) == set(targets.split())
    rows = tables("docs/development.md")["Make targets"]
    assert {code_words(row[0])[0] for row in rows} == {
        f"make {target}" for target in targets.split()
    }
