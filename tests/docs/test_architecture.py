"""The tour of the house names what is there."""

import re

import pytest

from tests.docs.pages import CHECKOUT, text_of

PAGES = ("docs/explanation/architecture.md", "docs/explanation/time.md")
PACKAGES = {path.name for path in (CHECKOUT / "src" / "traverse").iterdir()}
PATH = re.compile(rf"`((?:benchmarks|{'|'.join(PACKAGES)})/[a-z0-9_/.]*)`")
IN_DAEMON = re.compile(r"\| in `daemon/` \|.*?\n\n", re.DOTALL)
IN_LAB = re.compile(r"\| step \| modules of `lab/` \|.*?\n\n", re.DOTALL)


@pytest.mark.parametrize("page", PAGES)
def test_every_module_named_is_there(page: str) -> None:
    paths = PATH.findall(text_of(page))
    assert paths
    assert [path for path in paths if not (CHECKOUT / path).exists()] == []


@pytest.mark.parametrize(("table", "folder"), [(IN_DAEMON, "daemon"), (IN_LAB, "lab")])
def test_tables_of_folders_name_what_is_there(
    table: re.Pattern[str], folder: str
) -> None:
    found = table.search(text_of(PAGES[0]))
    assert found
    words = re.findall(r"`([a-z_/]+)`", found[0].split("\n", 1)[1])
    assert words
    root = CHECKOUT / folder
    missing = [
        word
        for word in words
        if not ((root / word).exists() or (root / f"{word}.py").exists())
    ]
    assert missing == []


def test_every_folder_of_the_daemon_is_in_its_table() -> None:
    found = IN_DAEMON.search(text_of(PAGES[0]))
    assert found
    folders = {path.parent.name for path in CHECKOUT.glob("daemon/*/__init__.py")}
    assert folders - set(re.findall(r"`([a-z_]+)/`", found[0])) == set()
