"""The text of a file from its plain values, in the layout people know.

Numbers are written in the shortest decimals that give back the same bits. The only
module that uses tomlkit.
"""

from collections.abc import Mapping, MutableMapping, Sequence
from typing import Any

import tomlkit
from tomlkit.items import AoT, Item

from traverse.strict_toml.writing import canonical_text


def rewritten_text(values: Mapping[str, Any], before: str | None = None) -> str:
    """Write values as TOML; keys that are None are left out.

    Comments of the text before stay, and so does every line whose value stays.
    """
    document = tomlkit.document() if before is None else tomlkit.parse(before)
    _fill(document, values)
    return tomlkit.dumps(document)


def _fill(table: MutableMapping[str, Any], values: Mapping[str, Any]) -> None:
    """Make a table hold just these values; equal ones are not touched."""
    new_values = {key: value for key, value in values.items() if value is not None}
    for key in [key for key in table if key not in new_values]:
        del table[key]
    for key, value in new_values.items():
        if isinstance(value, Mapping):
            known = isinstance(table.get(key), MutableMapping)
            inner = table[key] if known else tomlkit.table()
            _fill(inner, value)
            if not known:
                table[key] = inner
        elif _is_list_of_tables(value):
            _fill_list(table, key, value)
        elif key not in table or _differ(table[key], value):
            table[key] = list(value) if isinstance(value, tuple) else value


def _fill_list(
    table: MutableMapping[str, Any], key: str, values: Sequence[Mapping[str, Any]]
) -> None:
    known = isinstance(table.get(key), AoT)
    tables = table[key] if known else tomlkit.aot()
    while len(tables) > len(values):
        del tables[len(tables) - 1]
    for number, entry in enumerate(values):
        fresh = number == len(tables)
        inner = tomlkit.table() if fresh else tables[number]
        _fill(inner, entry)
        if fresh:
            tables.append(inner)
    if not known:
        table[key] = tables


def _differ(left: object, right: object) -> bool:
    """Whether two values differ in anything that a reader would see."""
    plain = left.unwrap() if isinstance(left, Item) else left
    return canonical_text(plain) != canonical_text(right)


def _is_list_of_tables(value: object) -> bool:
    return (
        isinstance(value, Sequence)
        and not isinstance(value, str)
        and len(value) > 0
        and all(isinstance(entry, Mapping) for entry in value)
    )
