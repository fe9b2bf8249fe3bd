"""Every block of the pages is good in its language, also where no test runs it."""

import ast
import importlib
import json
import re
import tomllib
from pathlib import Path

import pytest

from tests.docs.pages import PAGES, name_of
from tests.running import invoke

_BLOCK = re.compile(
    r"^ *```(?P<language>python|toml|json)\n(?P<text>.*?)^ *```$", re.DOTALL | re.M
)
BLOCKS = [
    (name_of(page), match["language"], match["text"])
    for page in PAGES
    for match in _BLOCK.finditer(page.read_text("utf-8"))
]


def of(language: str) -> list[tuple[str, str]]:
    """Page and text of all blocks in a language."""
    return [(page, text) for page, kind, text in BLOCKS if kind == language]


@pytest.mark.parametrize(("page", "text"), of("toml"))
def test_toml_can_be_read(page: str, text: str) -> None:
    assert tomllib.loads(text), page


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


@pytest.mark.parametrize(("page", "text"), of("json"))
def test_json_can_be_read(page: str, text: str) -> None:
    assert json.loads(text), page


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
