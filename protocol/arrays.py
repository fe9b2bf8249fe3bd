"""Numpy arrays inside MessagePack: the extension type with code 1.

The content of the extension, byte by byte, all integers little-endian:

| offset | size | what |
|---|---|---|
| 0 | 1 | kind, an ASCII letter: `b` bool, `i` signed, `u` unsigned, `f` float |
| 1 | 1 | size of one element in bytes: 1, 2, 4 or 8 (`b`: 1; `f`: 2, 4 or 8) |
| 2 | 1 | number of dimensions d, 1 to 4 |
| 3 | 4 d | the dimensions, u32 each, outermost first |
| 3 + 4 d | | the elements, little-endian, last index fastest (C order) |

A bool is 00 or 01. The length is exact: 3 + 4 d + size * product of dimensions.

Example: the unsigned 16-bit array [[1, 2, 515]] of shape (1, 3), as it is in a
message, with MessagePack's own header `C7 11 01` (ext 8, 17 bytes, code 1):

    C7 11 01  75 02 02  01 00 00 00  03 00 00 00  01 00  02 00  03 02
"""

import math
import struct

import numpy as np
from numpy.typing import NDArray

from traverse.plurals import counted
from traverse.protocol.message_error import MessageError

ARRAY_CODE = 1
"""Code of the MessagePack extension type."""

MAX_DIMENSIONS = 4
SIZES = {"b": (1,), "i": (1, 2, 4, 8), "u": (1, 2, 4, 8), "f": (2, 4, 8)}
_HEAD = struct.Struct("<BBB")


def array_to_bytes(array: NDArray[np.generic]) -> bytes:
    """Write an array as the content of the extension type.

    Args:
        array: any shape of 1 to 4 dimensions, of a bool, integer or float dtype.

    Raises:
        MessageError: the array has another dtype or number of dimensions.
    """
    kind, size = array.dtype.kind, array.dtype.itemsize
    if size not in SIZES.get(kind, ()):
        raise MessageError.of(
            "array", f"dtype {array.dtype}", "bool, int, uint or float of 1 to 8 bytes"
        )
    if not 1 <= array.ndim <= MAX_DIMENSIONS:
        raise MessageError.of(
            "array", f"{counted(array.ndim, 'dimension')}", f"1 to {MAX_DIMENSIONS}"
        )
    head = _HEAD.pack(ord(kind), size, array.ndim)
    shape = struct.pack(f"<{array.ndim}I", *array.shape)
    elements = array.astype(array.dtype.newbyteorder("<"), copy=False)
    return head + shape + elements.tobytes(order="C")


def bytes_to_array(content: bytes) -> NDArray[np.generic]:
    """Read the content of the extension type.

    Returns:
        A read-only array in the machine's own byte order.

    Raises:
        MessageError: the content breaks a rule of the layout.
    """
    dtype, shape, start = _read_head(content)
    expected = start + dtype.itemsize * math.prod(shape)
    if len(content) != expected:
        raise MessageError.of(
            "array",
            f"{counted(len(content), 'byte')} for shape {shape} of {dtype}",
            f"{counted(expected, 'byte')}",
        )
    # The slice is a copy, and so aligned for any element.
    elements = np.frombuffer(content[start:], dtype)
    if dtype.kind == "b" and elements.view(np.uint8).max(initial=0) > 1:
        raise MessageError.of("array", "a bool that is neither 00 nor 01", "00 or 01")
    try:
        array = elements.astype(dtype.newbyteorder("="), copy=False).reshape(shape)
    except ValueError as error:  # an empty array with huge other dimensions
        raise MessageError.of("array", f"shape {shape}", "a possible shape") from error
    array.flags.writeable = False
    return array


def _read_head(content: bytes) -> tuple[np.dtype[np.generic], tuple[int, ...], int]:
    """Dtype, shape and offset of the first element."""
    if len(content) < _HEAD.size:
        raise MessageError.of(
            "array", f"{counted(len(content), 'byte')}", "a head of at least 3 bytes"
        )
    kind_byte, size, n_dimensions = _HEAD.unpack_from(content)
    kind = chr(kind_byte)
    if size not in SIZES.get(kind, ()):
        raise MessageError.of(
            "array",
            f"kind {kind_byte:#04x} with elements of {size} bytes",
            "kind b, i, u or f with a size that it has",
        )
    if not 1 <= n_dimensions <= MAX_DIMENSIONS:
        raise MessageError.of(
            "array", f"{counted(n_dimensions, 'dimension')}", f"1 to {MAX_DIMENSIONS}"
        )
    start = _HEAD.size + 4 * n_dimensions
    if len(content) < start:
        raise MessageError.of(
            "array", f"{counted(len(content), 'byte')}", f"a head of {start} bytes"
        )
    shape = struct.unpack_from(f"<{n_dimensions}I", content, _HEAD.size)
    return np.dtype(f"<{kind}{size}" if kind != "b" else "?"), shape, start
