"""Outcomes of trials as a file of JSON lines, which a later run continues."""

import hashlib
import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

Line = dict[str, Any]

_CHECKOUT = Path(__file__).parent.parent.parent
# What an outcome depends on, beside its seed.
FOLDERS = ("benchmarks", "kinematics", "lab", "simulator")
_KINDS = frozenset({".py", ".pyx", ".pxd", ".pxi", ".c", ".h", ".inc", ".toml"})


def code_version(folders: Iterable[str] = FOLDERS) -> str:
    digest = hashlib.sha256()
    for folder in folders:
        for path in sorted((_CHECKOUT / folder).rglob("*")):
            if path.suffix in _KINDS:
                digest.update(path.relative_to(_CHECKOUT).as_posix().encode())
                digest.update(path.read_bytes())
    return digest.hexdigest()[:12]


def stored(path: Path) -> list[Line]:
    """Read the lines; one that was cut off in the middle of writing is left out."""
    if not path.exists():
        return []
    with path.open(encoding="utf-8") as file:
        return [json.loads(text) for text in file if text.endswith("\n")]


def append(path: Path, lines: Iterable[Line]) -> None:
    """Add lines; an incomplete last line, left by an interruption, is removed."""
    text = "".join(json.dumps(line, allow_nan=False) + "\n" for line in lines)
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("a+b") as file:
        if file.tell():
            file.seek(-1, 2)
            if file.read() != b"\n":
                file.seek(0)
                file.truncate(file.read().rfind(b"\n") + 1)
        file.write(text.encode())


def unbroken(lines: Iterable[Line]) -> list[Line]:
    return [line for line in lines if line["error"] is None]


def outcomes(lines: Iterable[Line], scenario: str) -> list[Any]:
    return [line["outcome"] for line in unbroken(lines) if line["scenario"] == scenario]
