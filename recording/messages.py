"""The messages of a recording, from bytes to values.

`samples` are MessagePack maps with arrays as on MQTT (`traverse.protocol.arrays`);
`touching` and `conditions` are JSON. Unknown keys are passed over: later recorders may
say more.
"""

import json
from typing import Any, TypeGuard

import msgpack
import numpy as np
from numpy.typing import NDArray

from traverse.protocol.arrays import ARRAY_CODE, bytes_to_array
from traverse.protocol.message_error import MessageError
from traverse.recording.values import TIMES, Conditions, Samples, Touching

SCHEMA = "traverse/recording/1"
TOPICS = ("samples", "touching", "conditions")
# A block in memory at a time, and what its header may announce.
_MOST_ELEMENTS = 1 << 16


def bytes_to_samples(content: bytes, n_joints: int) -> Samples:
    """Read a block of samples.

    Raises:
        ValueError: It is none; what was found and what was expected.
    """
    try:
        table = msgpack.unpackb(content, ext_hook=_unpacked, max_map_len=_MOST_ELEMENTS)
    except (MessageError, ValueError, msgpack.UnpackException) as error:
        raise ValueError(f"samples: not MessagePack with arrays: {error}") from error
    if not isinstance(table, dict):
        raise ValueError(f"samples: a {type(table).__name__}, expected a map")
    missing = [name for name in (*TIMES, "counts") if name not in table]
    if missing:
        raise ValueError(f"samples: {', '.join(missing)} missing; expected arrays")
    counts = _integers(table, "counts")
    if counts.ndim != 2 or counts.shape[1] != n_joints:
        raise ValueError(
            f"samples: counts have shape {counts.shape}, expected (n, {n_joints})"
        )
    if counts.size and not 0 <= int(counts.min()) <= int(counts.max()) < 2**32:
        raise ValueError("samples: counts are outside 0 to 2^32 - 1")
    times = {name: _integers(table, name).astype(np.int64) for name in TIMES}
    return Samples(**times, counts=counts.astype(np.uint32))


def bytes_to_touching(content: bytes) -> Touching:
    """Read what is touched from a moment on.

    Raises:
        ValueError: It is none; what was found and what was expected.
    """
    table = _json_table("touching", content)
    at_ns, artefact, feature = (
        table.get(key) for key in ("sample_time_ns", "artefact", "feature")
    )
    if not _is_moment(at_ns):
        raise ValueError(f"touching: sample_time_ns is {at_ns!r}, expected ns")
    if not isinstance(artefact, str | None):
        raise ValueError(f"touching: artefact is {artefact!r}, expected a name or null")
    if not isinstance(feature, str):
        raise ValueError(f"touching: feature is {feature!r}, expected a text")
    return Touching(at_ns, artefact, feature)


def bytes_to_conditions(content: bytes) -> Conditions:
    """Read the conditions of a moment.

    Raises:
        ValueError: They are none; what was found and what was expected.
    """
    table = _json_table("conditions", content)
    at_ns = table.get("sample_time_ns")
    if not _is_moment(at_ns):
        found = repr(at_ns)
        raise ValueError(f"conditions: sample_time_ns is {found}, expected ns")
    numbers: list[float | None] = []
    for key in ("temperature_c", "force_n"):
        value = table.get(key)
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        if value is not None and not (is_number and np.isfinite(value)):
            raise ValueError(f"conditions: {key} is {value!r}, expected a number")
        numbers.append(None if value is None else float(value))
    return Conditions(at_ns, *numbers)


def _unpacked(code: int, content: bytes) -> NDArray[Any]:
    if code != ARRAY_CODE:
        raise ValueError(f"extension type {code}, expected {ARRAY_CODE}, an array")
    return bytes_to_array(content)


def _integers(table: dict[str, Any], key: str) -> NDArray[Any]:
    array = table[key]
    if not isinstance(array, np.ndarray) or array.dtype.kind not in "iu":
        raise ValueError(f"samples: {key} is no array of integers")
    return array


def _json_table(topic: str, content: bytes) -> dict[str, Any]:
    try:
        table = json.loads(content)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{topic}: not JSON: {error}") from error
    if not isinstance(table, dict):
        raise ValueError(f"{topic}: a {type(table).__name__}, expected an object")
    return table


def _is_moment(value: object) -> TypeGuard[int]:
    if not isinstance(value, int) or isinstance(value, bool):
        return False
    return abs(value) < 2**63
