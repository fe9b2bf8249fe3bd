"""Integer arrays in few bytes: the first row, then differences in the least width.

The content of MessagePack extension type 2, all little-endian:

| offset | size | what |
|---|---|---|
| 0 | 1 | kind, an ASCII letter: `i` signed, `u` unsigned |
| 1 | 1 | size of one element in bytes: 1, 2, 4 or 8 |
| 2 | 1 | number of dimensions, 1 or 2 |
| 3 | 1 | width w of a difference: 1, 2, 4 or 8; 0 where all rows differ alike |
| 4 | 4 | number of rows n, u32 |
| 8 | 4 | number of columns k, u32; 1 with one dimension |
| 12 | 8 k | the first row, i64 |
| | w k (n - 1) | differences to the row before, column by column |

With w = 0 there is one i64 for each column instead, none where n < 2. Differences are
taken modulo 2^64, so that nothing is lost.
"""

import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

from traverse.arrays import Integers

DIFFERENCES_CODE = 2
"""Code of the MessagePack extension type."""

MOST_ELEMENTS = 1 << 22
_HEAD = struct.Struct("<BBBBII")
_WIDTHS = tuple((np.dtype(f"<i{size}"), 1 << 8 * size - 1) for size in (1, 2, 4))
"""Types of differences, and the first number that is too large for each."""


def differences_to_bytes(array: NDArray[np.integer[Any]]) -> bytes:
    n, k = array.shape if array.ndim == 2 else (len(array), 1)
    rows = array.astype(np.int64, copy=False).reshape(n, k)
    width, body = 0, b""
    if n > 1 and k:
        columns = (rows[1:] - rows[:-1]).T
        if (columns == columns[:, :1]).all():
            body = columns[:, 0].astype("<i8").tobytes()
        else:
            kind = _narrowest(columns)
            width, body = kind.itemsize, columns.astype(kind).tobytes()
    head = _HEAD.pack(
        ord(array.dtype.kind), array.dtype.itemsize, array.ndim, width, n, k
    )
    first = rows[:1].astype("<i8").tobytes() if n and k else b""
    return head + first + body


def bytes_to_differences(content: bytes) -> NDArray[Any]:
    """Read integers.

    Raises:
        ValueError: The content is not such an array.
    """
    if len(content) < _HEAD.size:
        raise ValueError(f"an array of {len(content)} bytes, expected {_HEAD.size}")
    kind, size, dimensions, width, n, k = _HEAD.unpack_from(content)
    if (
        chr(kind) not in "iu"
        or size not in (1, 2, 4, 8)
        or dimensions not in (1, 2)
        or (dimensions == 1 and k != 1)
        or width not in (0, 1, 2, 4, 8)
        or n * max(k, 1) > MOST_ELEMENTS
    ):
        raise ValueError("an array whose head makes no sense")
    k_first = k if n else 0
    n_differences = 0 if n < 2 else k if width == 0 else k * (n - 1)
    length = _HEAD.size + 8 * k_first + (width or 8) * n_differences
    if len(content) != length:
        raise ValueError(f"an array of {len(content)} bytes, expected {length}")
    rows = np.zeros((n, k), np.int64)
    if n and k:
        rows[0] = np.frombuffer(content, "<i8", k, _HEAD.size)
    if n > 1 and k:
        begin = _HEAD.size + 8 * k
        if width == 0:
            rows[1:] = np.frombuffer(content, "<i8", k, begin)
        else:
            differences = np.frombuffer(content, f"<i{width}", k * (n - 1), begin)
            rows[1:] = differences.reshape(k, n - 1).T
        np.cumsum(rows, axis=0, out=rows)
    array = rows.astype(f"{chr(kind)}{size}")
    return array[:, 0] if dimensions == 1 else array


def _narrowest(differences: Integers) -> np.dtype[Any]:
    least, most = int(differences.min()), int(differences.max())
    for kind, end in _WIDTHS:
        if -end <= least and most < end:
            return kind
    return np.dtype("<i8")
