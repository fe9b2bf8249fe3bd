"""Additions to the site: navigation, options, files of the checkout.

The navigation is the map in index.md: its headings and the links in its lists. Pages
link to files beside docs/ (the changelog, examples to copy) by their place in the
checkout; the site has those in checkout/, and links are turned there. Each section of a
command in reference/commands.md begins and ends with its --help.
"""

import html
import os
import re
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path
from typing import Any

import typer.main
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

from traverse.cli.__main__ import app
from traverse.cli.common.broker_options import BrokerOptions

DOCS = Path(__file__).resolve().parent.parent
CHECKOUT = DOCS.parent
OUTSIDE = "checkout"
BROKER = {field.name for field in fields(BrokerOptions)}

_CODE = re.compile(r"(^ *```.*?^ *```$|`[^`\n]*`)", re.DOTALL | re.MULTILINE)
_LINK = re.compile(r"(?<=\]\()(?P<path>[^)\s#:]+)(?P<anchor>#[^)\s]*)?(?=\))")
_HEADING = re.compile(r"^(?P<level>##+) (?P<text>.*)$")
_COMMAND = re.compile(
    r"^(?P<heading>## `traverse(?P<words>[^`]*)`)$(?P<text>.*?)(?=^## |\Z)",
    re.DOTALL | re.M,
)
_ITEM = re.compile(r"\[(?P<title>[^\]]+)\]\((?P<path>[^)\s#:]+)\)")


def on_config(config: MkDocsConfig) -> None:
    config.nav = navigation((DOCS / "index.md").read_text("utf-8"))


def navigation(index: str) -> list[Any]:
    """Return mkdocs' nav: titles and pages, in groups.

    Args:
        index: the text of index.md.
    """
    groups: list[Any] = []
    inner: list[Any] = groups
    top: list[Any] = groups
    for line in index.splitlines():
        if heading := _HEADING.match(line):
            inner = []
            if len(heading["level"]) == 2:
                top = inner
                groups.append({heading["text"]: inner})
            else:
                top.append({heading["text"]: inner})
        elif line.startswith("- "):
            inner += [
                {item["title"]: site_path(DOCS / item["path"])}
                for item in _ITEM.finditer(line)
                if item["path"].endswith(".md")
            ]
    return [{"Start": "index.md"}, *(group for group in groups if any(group.values()))]


def site_path(target: Path) -> str:
    real = Path(os.path.normpath(target))
    if real.is_relative_to(DOCS):
        return real.relative_to(DOCS).as_posix()
    return f"{OUTSIDE}/{real.relative_to(CHECKOUT).as_posix()}"


def on_files(files: Files, config: MkDocsConfig) -> Files:
    waiting = [Path(str(file.abs_src_path)) for file in files.documentation_pages()]
    known = set(waiting)
    while waiting:
        for target in links_outside(waiting.pop()):
            if target not in known:
                known.add(target)
                path = site_path(target)
                files.append(File.generated(config, path, abs_src_path=str(target)))
                if target.suffix == ".md":
                    waiting.append(target)
    return files


def links_outside(page: Path) -> Iterator[Path]:
    for part in _CODE.split(page.read_text("utf-8"))[::2]:
        for link in _LINK.finditer(part):
            target = Path(os.path.normpath(page.parent / link["path"]))
            if target.is_file() and not target.is_relative_to(DOCS):
                yield target


def on_page_markdown(
    markdown: str, page: Page, config: MkDocsConfig, files: Files
) -> str:
    """Add options of commands; turn links to where the site has their targets."""
    markdown = _COMMAND.sub(with_its_help, markdown)
    source = Path(str(page.file.abs_src_path)).parent
    place = Path(page.file.src_uri).parent

    def turned(link: re.Match[str]) -> str:
        target = source / link["path"]
        if not target.exists():
            return link[0]  # mkdocs says so
        path = os.path.relpath(site_path(target), place)
        return Path(path).as_posix() + (link["anchor"] or "")

    parts = _CODE.split(markdown)
    parts[::2] = [_LINK.sub(turned, part) for part in parts[::2]]
    return "".join(parts)


def with_its_help(section: re.Match[str]) -> str:
    """A command's section with its --help: purpose, arguments, options."""
    command: Any = typer.main.get_command(app)
    for word in section["words"].split():
        command = command.commands[word]
    left_out = BROKER if {option.name for option in command.params} >= BROKER else set()
    rows = ["| option | meaning |", "|---|---|"]
    for option in command.params:
        if option.name not in left_out:
            name, meaning = option.get_help_record(typer.Context(command))
            rows.append(f"| `{name}` | {html.escape(meaning)} |")
    rows += ["| [broker options](#brokers) | |"] if left_out else []
    does = html.escape(command.help, quote=False)
    options = "\n".join(rows) + "\n\n" if len(rows) > 2 else ""
    return f"{section['heading']}\n\n{does}\n{section['text']}\n{options}"
