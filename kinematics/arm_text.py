"""The text of an arm file from its plain values, in the layout people know.

Numbers are written in the shortest decimals that give back the same bits.
"""

import json
import os
from collections.abc import Mapping, Sequence
from datetime import UTC, date, datetime
from pathlib import Path
from typing import Any


def arm_text(values: Mapping[str, Any]) -> str:
    """Write the values of an arm as TOML; keys that are None are left out."""
    return "\n".join(_table_lines(values, ())).lstrip("\n") + "\n"


def canonical_text(values: object) -> str:
    """Write values so that equal ones give equal text, for a digest."""
    return json.dumps(_canonical(values), sort_keys=True, separators=(",", ":"))


def write_whole(path: Path, text: str) -> None:
    """Put a file in place of an old one, whole or not at all, and onto the disk."""
    # A symbolic link goes on pointing to the file; the file is replaced.
    target = path.resolve()
    fresh = target.with_name(f".{target.name}.{os.getpid()}.new")
    try:
        with fresh.open("x", encoding="utf-8", newline="\n") as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        fresh.replace(target)
    except BaseException:
        fresh.unlink(missing_ok=True)
        raise
    folder = os.open(target.parent, os.O_RDONLY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)


def _table_lines(table: Mapping[str, Any], path: tuple[str, ...]) -> list[str]:
    """Write a table: first its own keys, then the tables in it."""
    lines: list[str] = []
    inner: list[str] = []
    for key, value in table.items():
        here = (*path, key)
        if isinstance(value, Mapping):
            # A table inside an entry of a list stands close to its owner.
            gap = [""] if len(here) == 1 else []
            inner += [*gap, f"[{'.'.join(here)}]", *_table_lines(value, here)]
        elif _is_list_of_tables(value):
            for entry in value:
                inner += ["", f"[[{'.'.join(here)}]]", *_table_lines(entry, here)]
        elif value is not None:
            lines.append(f"{key} = {_value_text(value)}")
    return lines + inner


def _is_list_of_tables(value: object) -> bool:
    return (
        isinstance(value, Sequence)
        and not isinstance(value, str)
        and len(value) > 0
        and all(isinstance(entry, Mapping) for entry in value)
    )


def _value_text(value: object) -> str:
    if isinstance(value, str):
        # Strings of JSON are strings of TOML, but for the delete character.
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, int | float):
        return repr(value)
    if isinstance(value, datetime):
        return value.isoformat().replace("+00:00", "Z")
    if isinstance(value, date):
        return value.isoformat()
    if isinstance(value, Sequence):
        return f"[{', '.join(_value_text(entry) for entry in value)}]"
    raise TypeError(f"an arm file cannot hold {value!r}, a {type(value).__name__}")


def _canonical(value: object) -> object:
    if isinstance(value, Mapping):
        return {key: _canonical(entry) for key, entry in value.items()}
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [_canonical(entry) for entry in value]
    if isinstance(value, float):
        return value.hex()
    if isinstance(value, datetime) and value.tzinfo is not None:
        return value.astimezone(UTC).isoformat()
    if isinstance(value, date):
        return value.isoformat()
    return value
