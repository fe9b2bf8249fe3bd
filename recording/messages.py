"""The messages of a recording, from bytes to values.

`samples` are MessagePack maps with arrays as on MQTT (`traverse.protocol.arrays`);
`touching` and `conditions` are JSON. Unknown keys are passed over: later recorders may
say more.
"""

import json
from typing import Any

import numpy as np
from numpy.typing import NDArray

from traverse.recording.maps import bytes_to_map
from traverse.recording.values import TIMES, Conditions, Samples, Touching

SCHEMA = "traverse/recording/1"
TOPICS = ("samples", "touching", "conditions")


def bytes_to_samples(content: bytes, n_joints: int) -> Samples:
    """Read a block of samples.

    Raises:
        ValueError: It is none; what was found and what was expected.
    """
    try:
        table = bytes_to_map(content)
    except ValueError as error:
        raise ValueError(f"samples: {error}") from error
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
    table, at_ns = _json_table("touching", content)
    artefact, feature = table.get("artefact"), table.get("feature")
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
    table, at_ns = _json_table("conditions", content)
    numbers: list[float | None] = []
    for key in ("temperature_c", "force_n"):
        value = table.get(key)
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        if value is not None and not (is_number and np.isfinite(value)):
            raise ValueError(f"conditions: {key} is {value!r}, expected a number")
        numbers.append(None if value is None else float(value))
    return Conditions(at_ns, *numbers)


def _integers(table: dict[str, Any], key: str) -> NDArray[Any]:
    array = table[key]
    if not isinstance(array, np.ndarray) or array.dtype.kind not in "iu":
        raise ValueError(f"samples: {key} is no array of integers")
    return array


def _json_table(topic: str, content: bytes) -> tuple[dict[str, Any], int]:
    """An object of JSON, and its moment."""
    try:
        table = json.loads(content)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{topic}: not JSON: {error}") from error
    if not isinstance(table, dict):
        raise ValueError(f"{topic}: a {type(table).__name__}, expected an object")
    at_ns = table.get("sample_time_ns")
    if type(at_ns) is not int or abs(at_ns) >= 2**63:
        raise ValueError(f"{topic}: sample_time_ns is {at_ns!r}, expected ns")
    return table, at_ns
