"""Maps of anything that JSON can hold: data of events, arguments, results.

Checked by hand, since a union of types would report six mistakes for each wrong value,
and a hostile payload can hold a hundred thousand of them: here the first one ends it.
"""

import math
from typing import Annotated, Any, NoReturn

from pydantic import PlainValidator, WithJsonSchema

from traverse.protocol.messages.fields import MAX_INTEGER

MAX_NAME = 64
MAX_TEXT = 2000
MAX_LENGTH = 4096
"""Elements of one list or map."""
MAX_LEVELS = 12
"""Maps and lists inside each other, the outermost counted."""


def plain_map(value: object) -> dict[str, Any]:
    """The map with lists as tuples, checked throughout.

    Raises:
        ValueError: the first mistake and where it is.
    """
    if not isinstance(value, dict):
        raise ValueError(f"a map, not {type(value).__name__}")
    return _map(value, "", 1)


def _plain(value: object, where: str, level: int) -> object:
    if value is None or isinstance(value, bool):
        return value
    if isinstance(value, str):
        return _text(value, where)
    if isinstance(value, int | float):
        return _number(value, where)
    if level == MAX_LEVELS:
        _refuse(where, f"at most {MAX_LEVELS} levels of nesting")
    if isinstance(value, dict):
        return _map(value, f"{where}.", level + 1)
    if not isinstance(value, list | tuple):
        kind = type(value).__name__
        _refuse(where, f"null, bool, number, text, list or map, not {kind}")
    if len(value) > MAX_LENGTH:
        _refuse(where, f"at most {MAX_LENGTH} elements")
    return tuple(
        _plain(item, f"{where}.{i}", level + 1) for i, item in enumerate(value)
    )


def _map(value: dict[object, object], prefix: str, level: int) -> dict[str, Any]:
    if len(value) > MAX_LENGTH:
        _refuse(prefix, f"at most {MAX_LENGTH} keys")
    if not all(map(_is_name, value)):
        _refuse(prefix, f"keys of 1 to {MAX_NAME} characters of Unicode")
    return {
        str(key): _plain(item, f"{prefix}{key}", level) for key, item in value.items()
    }


def _number(value: float, where: str) -> int | float:
    if isinstance(value, int):
        if abs(value) > MAX_INTEGER:
            _refuse(where, f"an integer from -{MAX_INTEGER} to {MAX_INTEGER}")
        return int(value)
    if not math.isfinite(value):
        _refuse(where, "a finite number")
    return float(value)


def _text(value: str, where: str) -> str:
    if len(value) > MAX_TEXT or not _is_encodable(value):
        _refuse(where, f"a text of at most {MAX_TEXT} characters of Unicode")
    return value


def _is_name(key: object) -> bool:
    return isinstance(key, str) and 1 <= len(key) <= MAX_NAME and _is_encodable(key)


def _is_encodable(text: str) -> bool:
    """Return whether UTF-8 can encode a text: a lone surrogate it cannot."""
    return text.isascii() or not any(
        "\ud800" <= character <= "\udfff" for character in text
    )


def _refuse(where: str, expected: str) -> NoReturn:
    raise ValueError(f"in {where[:80]!r} {expected}" if where else expected)


PlainMap = Annotated[
    dict[str, Any],
    PlainValidator(plain_map),
    WithJsonSchema({"type": "object", "propertyNames": {"maxLength": 64}}),
]
"""Names to null, bool, finite number, integer of 53 bits, text, list, map of such."""
