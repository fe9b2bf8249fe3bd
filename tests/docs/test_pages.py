"""Every link inside the documentation leads somewhere; tables are whole.

Every block of the pages is good in its language, also where no test runs it.
Every code that the daemon can send is explained, and no other.
The tour of the house names what is there.
"""

import ast
import importlib
import json
import re
import tomllib
from pathlib import Path

import pytest

from tests.docs.pages import CHECKOUT, PAGES, anchors, name_of, relative_links, text_of
from tests.running import invoke


def is_broken(page: Path, link: str) -> bool:
    """Whether a link of a page leads nowhere, or out of the checkout."""
    path, _, anchor = link.partition("#")
    target = (page.parent / path).resolve() if path else page
    if not target.is_relative_to(CHECKOUT) or not target.exists():
        return True
    return bool(anchor) and anchor not in anchors(target)


def test_links_resolve() -> None:
    broken = {
        (name_of(page), link)
        for page in PAGES
        for link in relative_links(page)
        if is_broken(page, link)
    }
    assert broken == set()


def test_every_row_of_a_table_has_the_cells_of_its_head() -> None:
    for page in PAGES:
        text = page.read_text("utf-8")
        text = re.sub(r"^ *```.*?^ *```$", "", text, flags=re.S | re.M)
        for table in re.findall(r"(?:^ *\|.*\|\n)+", text, re.M):
            rows = table.splitlines()
            bars = {row: len(re.findall(r"(?<!\\)\|", row)) for row in rows}
            assert len(set(bars.values())) == 1, (name_of(page), bars)


def test_the_map_leads_to_every_page() -> None:
    index = CHECKOUT / "docs" / "index.md"
    linked = {(index.parent / link).resolve() for link in relative_links(index)}
    pages = {page for page in PAGES if page.is_relative_to(index.parent)} - {index}
    assert pages <= linked


_BLOCK = re.compile(
    r"^ *```(?P<language>python|toml|json)\n(?P<text>.*?)^ *```$", re.DOTALL | re.M
)
BLOCKS = [
    (name_of(page), match["language"], match["text"])
    for page in PAGES
    for match in _BLOCK.finditer(page.read_text("utf-8"))
]


def of(language: str) -> list[tuple[str, str]]:
    return [(page, text) for page, kind, text in BLOCKS if kind == language]


def test_toml_and_json_can_be_read() -> None:
    for page, text in of("toml"):
        assert tomllib.loads(text), page
    for page, text in of("json"):
        assert json.loads(text), page


@pytest.mark.parametrize(
    ("page", "text"),
    [
        (page, text)
        for page, text in of("toml")
        if re.search(r'"traverse/(acceptance-limits|probes|collection-plan)/', text)
    ],
)
def test_files_of_ours_are_valid(page: str, text: str, tmp_path: Path) -> None:
    path = tmp_path / "shown.toml"
    path.write_text(text, "utf-8")
    invoke("check", path)


@pytest.mark.parametrize(("page", "text"), of("python"))
def test_what_python_imports_is_there(page: str, text: str) -> None:
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.ImportFrom) and node.module:
            module = importlib.import_module(node.module)
            for name in node.names:
                assert hasattr(module, name.name), (page, node.module, name.name)
        elif isinstance(node, ast.Import):
            for name in node.names:
                assert importlib.import_module(name.name), page


EVENTS = (CHECKOUT / "docs" / "reference" / "events.md").read_text("utf-8")
SUBJECTS = (
    "device command commands capture broker scan limit reload "
    "clock watchdog realtime metrics outbox resend recording replay reference "
    "condition home input"
)
CODE = re.compile(rf'"((?:{"|".join(SUBJECTS.split())})\.(?!db")[a-z_]+)"')
FAULT = re.compile(r'(?:fault|_by_node)\((?:\s*[\w.]+,)?\s*"([a-z_]+)"')


def codes_in_the_code() -> set[str]:
    codes = set()
    for package in ("daemon", "drivers"):
        for path in (CHECKOUT / package).rglob("*.py"):
            text = path.read_text("utf-8")
            codes |= set(CODE.findall(text))
            codes |= {f"device.{name}" for name in FAULT.findall(text)}
    return codes


def test_every_code_is_explained_and_no_other() -> None:
    explained = set(re.findall(r"`([a-z]+\.[a-z_]+)`", EVENTS))
    of_inputs = {code for code in explained if code.startswith(("button", "switch"))}
    assert explained - of_inputs == codes_in_the_code()


TOUR = ("docs/explanation/architecture.md", "docs/explanation/time.md")
PACKAGES = {path.name for path in (CHECKOUT / "src" / "traverse").iterdir()}
PATH = re.compile(rf"`((?:benchmarks|{'|'.join(PACKAGES)})/[a-z0-9_/.]*)`")
IN_DAEMON = re.compile(r"\| in `daemon/` \|.*?\n\n", re.DOTALL)
IN_LAB = re.compile(r"\| step \| modules of `lab/` \|.*?\n\n", re.DOTALL)


@pytest.mark.parametrize("page", TOUR)
def test_every_module_named_is_there(page: str) -> None:
    paths = PATH.findall(text_of(page))
    assert paths
    assert [path for path in paths if not (CHECKOUT / path).exists()] == []


@pytest.mark.parametrize(("table", "folder"), [(IN_DAEMON, "daemon"), (IN_LAB, "lab")])
def test_tables_of_folders_name_what_is_there(
    table: re.Pattern[str], folder: str
) -> None:
    match = table.search(text_of(TOUR[0]))
    assert match
    words = re.findall(r"`([a-z_/]+)`", match[0].split("\n", 1)[1])
    assert words
    root = CHECKOUT / folder
    missing = [
        word
        for word in words
        if not ((root / word).exists() or (root / f"{word}.py").exists())
    ]
    assert missing == []


def test_every_folder_of_the_daemon_is_in_its_table() -> None:
    match = IN_DAEMON.search(text_of(TOUR[0]))
    assert match
    folders = {path.parent.name for path in CHECKOUT.glob("daemon/*/__init__.py")}
    assert folders - set(re.findall(r"`([a-z_]+)/`", match[0])) == set()
