import re
from pathlib import Path
from typing import Any

import typer.main

from traverse.cli.__main__ import app

CHECKOUT = Path(__file__).parents[2]
PAGES = sorted(
    [CHECKOUT / "README.md", CHECKOUT / "CHANGELOG.md", *CHECKOUT.glob("docs/**/*.md")]
)

_EXAMPLE = re.compile(
    r"<!-- example: (?P<kind>\w+) -->\n```(?P<language>\w+)\n(?P<text>.*?)^```$",
    re.DOTALL | re.MULTILINE,
)
_KEY = re.compile(
    r"^- (`[^`]+`(?: `[^`]+`)?) \((required|none|`[^`]*`)\)(.*(?:\n  .*)*)",
    re.MULTILINE,
)
_CODE = re.compile(r"^```.*?^```$|`[^`\n]*`", re.DOTALL | re.MULTILINE)
_LINK = re.compile(r"\]\(([^)\s]+)\)")
_HEADING = re.compile(r"^(?P<level>#+) (?P<text>.*)$", re.MULTILINE)


def _subcommands(command: Any, name: str) -> dict[str, Any]:
    """A command and all below it by full names, groups first."""
    by_words = {name: command}
    for word, inner in getattr(command, "commands", {}).items():
        if not inner.hidden:
            by_words |= _subcommands(inner, f"{name} {word}")
    return by_words


COMMANDS = _subcommands(typer.main.get_command(app), "traverse")


def name_of(page: Path) -> str:
    return str(page.relative_to(CHECKOUT))


def text_of(name: str) -> str:
    return (CHECKOUT / name).read_text("utf-8")


def examples(kind: str) -> list[tuple[str, str]]:
    return [
        (name_of(page), match["text"])
        for page in PAGES
        for match in _EXAMPLE.finditer(page.read_text("utf-8"))
        if match["kind"] == kind
    ]


def write_configurations(page: str, folder: Path, port: int) -> None:
    """Write a page's simulator.toml and daemon.toml, for a broker on another port."""
    for kind in ("simulator", "daemon"):
        ((_, text),) = [example for example in examples(kind) if example[0] == page]
        text = text.replace("port = 1883", f"port = {port}")
        (folder / f"{kind}.toml").write_text(text, "utf-8")


def kinds_of_examples() -> set[str]:
    return {
        match["kind"]
        for page in PAGES
        for match in _EXAMPLE.finditer(page.read_text("utf-8"))
    }


def relative_links(page: Path) -> list[str]:
    prose = _CODE.sub("", page.read_text("utf-8"))
    return [link for link in _LINK.findall(prose) if "://" not in link]


def anchors(page: Path) -> set[str]:
    """Anchors of a page, as GitHub makes them of the headings."""
    text = re.sub(r"^```.*?^```$", "", page.read_text("utf-8"), flags=re.S | re.M)
    plain = (match["text"].lower() for match in _HEADING.finditer(text))
    return {re.sub(r"[^\w\- ]", "", heading).replace(" ", "-") for heading in plain}


def tables(name: str) -> dict[str, list[list[str]]]:
    """The first table or list of keys below each heading of a page, row by row.

    A table without its head; of a list key, default in parentheses, and meaning.
    """
    text = text_of(name)
    headings = list(_HEADING.finditer(text))
    ends = [*(heading.start() for heading in headings[1:]), len(text)]
    by_heading = {}
    for heading, end in zip(headings, ends, strict=True):
        section = text[heading.end() : end]
        table = re.search(r"(?:^\|.*\|\n)+", section, re.MULTILINE)
        if keys := _KEY.findall(section):
            by_heading[heading["text"]] = [list(key) for key in keys]
        elif table:
            rows = [line[1:-1].split("|") for line in table[0].splitlines()]
            by_heading[heading["text"]] = [
                [cell.strip() for cell in r] for r in rows[2:]
            ]
    return by_heading


def code_words(cell: str) -> list[str]:
    return re.findall(r"`([^`]+)`", cell)


_SHELL = re.compile(
    r"^(?P<indent> *)```(?P<language>console|sh)\n(?P<text>.*?)^ *```$",
    re.DOTALL | re.M,
)


def commands(name: str) -> list[str]:
    """The shell commands that a page shows, in order; comments taken off.

    In a block of `console` they follow "$ ", in one of `sh` on every line.
    """
    command_lines = []
    for block in _SHELL.finditer(text_of(name)):
        lines = [line[len(block["indent"]) :] for line in block["text"].splitlines()]
        while lines:
            line = lines.pop(0)
            if block["language"] == "console":
                if not line.startswith("$ "):
                    continue
                line = line[2:]
            while line.endswith("\\"):
                line = line[:-1] + lines.pop(0).strip()
            command_lines.append(re.sub(r"\s+# .*$", "", line))
    return command_lines
