import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer
from typer.testing import CliRunner

from tests.cli.test_json_everywhere import commands
from traverse.cli.common.options import CommandGroup, Json


@dataclass(frozen=True, kw_only=True)
class Place:
    """A place.

    Attributes:
        x_mm: Along the table,
            in two lines.
    """

    x_mm: float = 1.5


def shown(
    name: str,
    *,
    strict: bool = False,
    colour: bool = True,
    most: Annotated[int, typer.Option("--most", "-m", min=1)] = 3,
    place: Place,
    as_json: Json = False,
) -> None:
    """Show all that is given.

    Args:
        name: What it is called.
        strict: Nothing may be missing.
        colour: Not in grey.
        most: So many at most.
    """
    typer.echo(f"{name} {strict} {colour} {most} {place} {as_json}")


def run(*words: str) -> str:
    app = CommandGroup("app", rich_markup_mode=None)
    app.command()(shown)
    return CliRunner().invoke(app, words, env={"COLUMNS": "120"}).output


def test_help_is_that_of_the_docstrings() -> None:
    help_text = " ".join(run("--help").split())
    assert "Show all that is given." in help_text
    assert "Args:" not in help_text
    assert "name <str> What it is called." in help_text
    assert "--strict Nothing may be missing." in help_text  # and no --no-strict
    assert "--colour / --no-colour Not in grey." in help_text
    assert "-m, --most <int range> So many at most." in help_text
    assert "--x-mm <float> Along the table, in two lines." in help_text
    assert "--json Report as JSON on standard output." in help_text


def test_a_group_arrives_as_one_value() -> None:
    printed = run("a", "--strict", "--x-mm", "2", "-m", "1", "--no-colour", "--json")
    assert printed == "a True False 1 Place(x_mm=2.0) True\n"
    assert run("b") == "b False True 3 Place(x_mm=1.5) False\n"


def test_every_option_of_every_command_has_help() -> None:
    silent = [
        (name, option.name)
        for name, command in commands()
        for option in command.params
        if not option.help
    ]
    assert silent == []


def test_commands_work_without_docstrings(tmp_path: Path) -> None:
    words = (sys.executable, "-OO", "-m", "traverse", "check", "--help")
    output = subprocess.run(words, check=True, cwd=tmp_path, capture_output=True).stdout
    assert b"--json" in output
