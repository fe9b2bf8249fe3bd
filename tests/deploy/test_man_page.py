"""The manual page agrees with the command line."""

import re
import sys
from pathlib import Path

import pytest

from tests.deploy.places import DEPLOY, program, said
from traverse.cli.__main__ import app


def written() -> str:
    """The page in roff."""
    return said(sys.executable, DEPLOY / "package/man_page.py")


def test_every_command_and_group_has_its_part() -> None:
    parts = set(re.findall(r"^\.SS traverse (\S+)$", written(), re.MULTILINE))
    names = {
        str(one.name or getattr(one.callback, "__name__", "")).replace("_", "\\-")
        for one in app.registered_commands
        if not one.hidden
    }
    groups = {one.typer_instance.info.name for one in app.registered_groups}
    assert names | groups <= parts


@pytest.mark.needs("groff")
def test_man_prints_it_without_a_warning(tmp_path: Path) -> None:
    page = tmp_path / "traverse.1"
    page.write_text(written(), "utf-8")
    groff = program("groff")
    told = said(groff, "-man", "-Tutf8", "-ww", "-b", "-z", page)
    assert told == ""
