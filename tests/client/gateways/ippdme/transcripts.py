"""Transcripts of conversations, for any parser of the grammar in the specification.

Each is two files in build/ippdme: commands in NAME.cmd, answers in NAME.res, one
a line.
"""

from collections.abc import Iterable
from pathlib import Path

FOLDER = Path(__file__).parents[4] / "build" / "ippdme"


def write(name: str, commands: Iterable[str], replies: Iterable[str]) -> None:
    FOLDER.mkdir(parents=True, exist_ok=True)
    for kind, lines in (("cmd", commands), ("res", replies)):
        text = "".join(f"{line}\n" for line in lines)
        (FOLDER / f"{name}.{kind}").write_text(text, "ascii")
