"""Messages to payloads and back, in MessagePack and in JSON.

Law: whatever the bytes, `decode` returns a message or raises MessageError, and its
memory and time are bounded by the size of the payload.
"""

import json
import re
from typing import Any, Literal, Never, TypeVar

import msgpack
import numpy as np
from pydantic import ValidationError

from traverse.protocol.arrays import ARRAY_CODE, array_to_bytes, bytes_to_array
from traverse.protocol.message_error import MessageError
from traverse.protocol.messages import COMMANDS, Args, Message
from traverse.protocol.messages.plain import MAX_LENGTH

Encoding = Literal["msgpack", "json"]

MAX_BYTES = 1 << 20
BUFFER_BYTES = 1 << 15
"""Initial size: the library's quarter of a megabyte is mapped each time."""
MAX_DEPTH = 16
"""Depth of nested maps and arrays, the message included."""
MAX_ELEMENTS = MAX_LENGTH
"""Bound of an array or map: the decoder reserves as many as a header announces."""

# Possessive, and an unclosed text runs to the end: one pass whatever the bytes.
_JSON_TEXT = re.compile(rb'"[^"\\]*+(?:\\.[^"\\]*+)*+"?', re.DOTALL)
_MessageT = TypeVar("_MessageT", bound=Message)


def content_type(encoding: Encoding) -> str:
    return f"application/{encoding}"


def encode(message: Message, encoding: Encoding) -> bytes:
    if encoding == "json":
        return message.model_dump_json().encode()
    payload: bytes = msgpack.packb(
        message.model_dump(), default=_pack_array, buf_size=BUFFER_BYTES
    )
    return payload


def decode(
    message_type: type[_MessageT],
    payload: bytes,
    encoding: Encoding | None = None,
    *,
    max_bytes: int = MAX_BYTES,
    max_elements: int = MAX_ELEMENTS,
) -> _MessageT:
    """Read a message from a payload.

    Args:
        message_type: as by the topic.
        payload: from anybody, trusted in nothing.
        encoding: None: JSON if it begins with a brace, else MessagePack.
        max_bytes: a longer payload is refused unread.
        max_elements: of one array or map in MessagePack.

    Raises:
        MessageError: the payload is not such a message; all its mistakes.
    """
    name = message_type.__name__.lower()
    if len(payload) > max_bytes:
        raise MessageError.of(name, f"{len(payload)} bytes", f"at most {max_bytes}")
    if encoding is None:
        encoding = "json" if payload.lstrip(b" \t\r\n")[:1] == b"{" else "msgpack"
    if encoding == "json":
        values = _read_json(name, payload)
    else:
        values = _read_msgpack(name, payload, max_elements)
    _check_schema(message_type, name, values)
    try:
        if encoding == "json":
            return message_type.model_validate_json(payload)
        return message_type.model_validate(values)
    except ValidationError as error:
        raise MessageError.from_validation(name, error) from error


def parse_args(command: str, args: dict[str, Any]) -> Args:
    """Read the arguments of a command, as its envelope holds them.

    Raises:
        MessageError: there is no such command, or its arguments are wrong.
    """
    if command not in COMMANDS:
        raise MessageError.of("command", repr(command), f"one of {', '.join(COMMANDS)}")
    try:
        return COMMANDS[command].model_validate(args)
    except ValidationError as error:
        raise MessageError.from_validation("args", error) from error


def _pack_array(value: object) -> msgpack.ExtType:
    if not isinstance(value, np.ndarray):
        raise TypeError(
            f"{type(value).__name__} in a message; only arrays are extensions"
        )
    return msgpack.ExtType(ARRAY_CODE, array_to_bytes(value))


def _unpack_array(code: int, content: bytes) -> object:
    if code != ARRAY_CODE:
        raise MessageError.of(
            "payload", f"extension type {code}", f"only {ARRAY_CODE}, an array"
        )
    return bytes_to_array(content)


def _read_msgpack(name: str, payload: bytes, max_elements: int) -> object:
    try:
        values = msgpack.unpackb(
            payload,
            use_list=False,
            object_pairs_hook=_unique,
            ext_hook=_unpack_array,
            max_array_len=max_elements,
            max_map_len=max_elements,
        )
    except MessageError:
        raise
    except (ValueError, TypeError, OverflowError, RecursionError) as error:
        raise MessageError.of(
            name, f"{error} ({type(error).__name__})", "one whole MessagePack map"
        ) from error
    if isinstance(values, dict):
        _check_depth(name, values)
    return values


def _check_depth(name: str, values: dict[str, object]) -> None:
    """Check level by level, so that the check itself needs no depth."""
    level: list[Any] = [values]
    for _ in range(MAX_DEPTH):
        level = [
            inner
            for outer in level
            for inner in (outer.values() if isinstance(outer, dict) else outer)
            if isinstance(inner, dict | tuple)
        ]
        if not level:
            return
    raise MessageError.of(name, "deeper nesting", f"at most {MAX_DEPTH} levels")


def _read_json(name: str, payload: bytes) -> object:
    depth = 0
    for bracket in re.findall(rb"[\[\]{}]", _JSON_TEXT.sub(b"", payload)):
        depth += 1 if bracket in b"[{" else -1
        if depth > MAX_DEPTH:
            raise MessageError.of(name, "deeper nesting", f"at most {MAX_DEPTH} levels")
    try:
        return json.loads(
            payload.decode(), object_pairs_hook=_unique, parse_constant=_refuse_constant
        )
    except MessageError:
        raise
    except (ValueError, RecursionError) as error:
        raise MessageError.of(name, str(error), "one JSON object in UTF-8") from error


def _unique(pairs: list[tuple[Any, Any]]) -> dict[str, Any]:
    values = dict(pairs)
    if len(values) != len(pairs):
        raise MessageError.of("payload", "a key given twice in a map", "each key once")
    if not all(type(key) is str for key in values):
        raise MessageError.of("payload", "a key that is no text", "keys that are texts")
    return values


def _refuse_constant(constant: str) -> Never:
    raise MessageError.of("payload", constant, "finite numbers")


def _check_schema(message_type: type[Message], name: str, values: object) -> None:
    """Report a payload of another kind in one line, not key by key."""
    expected = message_type.model_fields["schema_"].default
    if not isinstance(values, dict):
        raise MessageError.of(name, type(values).__name__, "a map of keys to values")
    if values.get("schema") != expected:
        raise MessageError.of(
            f"{name}.schema", repr(values.get("schema"))[:80], repr(expected)
        )
