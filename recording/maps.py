"""Maps of plain values and arrays, as MessagePack and back.

Integer arrays are written as differences (`traverse.recording.differences`), all others
as on MQTT (`traverse.protocol.arrays`).
"""

from collections.abc import Mapping
from typing import Any

import msgpack
import numpy as np

from traverse.protocol.arrays import ARRAY_CODE, array_to_bytes, bytes_to_array
from traverse.protocol.message_error import MessageError
from traverse.recording.differences import (
    DIFFERENCES_CODE,
    bytes_to_differences,
    differences_to_bytes,
)

BUFFER_BYTES = 1 << 14  # to write into, at first; the library's own is 256 KiB
MOST_ENTRIES = 1 << 16
"""Bound of a list or map: the decoder reserves as many as a header announces."""


def map_to_bytes(table: Mapping[str, object]) -> bytes:
    """Write a map of texts, numbers, lists, maps and arrays."""
    packed: bytes = msgpack.packb(table, default=_packed, buf_size=BUFFER_BYTES)
    return packed


def bytes_to_map(content: bytes) -> dict[str, Any]:
    """Read a map; lists become tuples.

    Raises:
        ValueError: It is not a map.
    """
    try:
        table = msgpack.unpackb(
            content,
            use_list=False,
            ext_hook=_unpacked,
            max_array_len=MOST_ENTRIES,
            max_map_len=MOST_ENTRIES,
        )
    except (
        MessageError,
        ValueError,
        TypeError,
        OverflowError,
        RecursionError,
        msgpack.UnpackException,
    ) as error:
        raise ValueError(f"not a MessagePack map: {error}") from error
    if not isinstance(table, dict):
        raise ValueError(f"a {type(table).__name__}, expected a map")
    if not all(isinstance(key, str) for key in table):
        raise ValueError("a map with a key that is no text")
    return table


def _packed(value: object) -> msgpack.ExtType:
    if isinstance(value, np.ndarray):
        if value.dtype.kind in "iu" and value.ndim in (1, 2):
            return msgpack.ExtType(DIFFERENCES_CODE, differences_to_bytes(value))
        return msgpack.ExtType(ARRAY_CODE, array_to_bytes(value))
    if isinstance(value, Mapping):
        return dict(value)
    message = f"{type(value).__name__} in a map; expected plain values and arrays"
    raise TypeError(message)


def _unpacked(code: int, content: bytes) -> object:
    if code == ARRAY_CODE:
        return bytes_to_array(content)
    if code == DIFFERENCES_CODE:
        return bytes_to_differences(content)
    raise ValueError(f"extension type {code}, expected an array")
