"""Writes the manual page traverse(1) from the help of the command line."""

import re
import sys
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path

import typer
import typer.main
from typer.core import TyperCommand, TyperGroup

from traverse.cli.__main__ import app

AnyCommand = TyperCommand | TyperGroup
TEMPLATE = Path(__file__).with_name("traverse.1.template")


def escaped(text: str) -> str:
    """Escape a text for roff, without line breaks inside sentences."""
    plain = re.sub(r"\s+", " ", text.replace("\\", "\\e").replace("`", "")).strip()
    plain = plain.replace("-", "\\-")
    return f"\\&{plain}" if plain.startswith((".", "'")) else plain


def paragraphs(help_text: str) -> str:
    parts = re.split(r"\n\s*\n", help_text.replace("\b", "").replace("\f", ""))
    return "\n.PP\n".join(escaped(part) for part in parts)


def parameters(command: AnyCommand) -> Iterator[str]:
    context = typer.Context(command, info_name=command.name)
    for parameter in command.get_params(context):
        record = parameter.get_help_record(context)
        if record is not None:
            words, meaning = record
            yield f".TP\n.B {escaped(words)}\n{escaped(meaning)}"


def sections(command: AnyCommand, name: str) -> Iterator[str]:
    yield f".SS {escaped(name)}\n{paragraphs(command.help or '')}"
    yield from parameters(command)
    for word, subcommand in getattr(command, "commands", {}).items():
        yield from sections(subcommand, f"{name} {word}")


def page() -> str:
    top = typer.main.get_command(app)
    parts = [
        paragraphs(top.help or ""),
        ".SH OPTIONS",
        *parameters(top),
        ".SH COMMANDS",
    ]
    for word, command in getattr(top, "commands", {}).items():
        if not command.hidden:
            parts += sections(command, f"traverse {word}")
    template = TEMPLATE.read_text("utf-8")
    return template.format(version=version("traverse-cmm"), text="\n".join(parts))


if __name__ == "__main__":
    sys.stdout.write(page())
