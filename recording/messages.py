"""The messages of a recording, from bytes to values.

`samples` are MessagePack maps with arrays as on MQTT (`traverse.protocol.arrays`);
`touching` and `conditions` are JSON. Unknown keys are passed over: later recorders may
say more.
"""

from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter, ValidationError

from traverse.recording.maps import bytes_to_map
from traverse.recording.values import TIMES, Conditions, Samples, Touching
from traverse.strict_toml.problems import problem_from_error

SCHEMA = "traverse/recording/1"
TOPICS = ("samples", "touching", "conditions")
_TOUCHING, _CONDITIONS = TypeAdapter(Touching), TypeAdapter(Conditions)
T = TypeVar("T")


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
    return _from_json("touching", content, _TOUCHING)


def bytes_to_conditions(content: bytes) -> Conditions:
    """Read the conditions of a moment.

    Raises:
        ValueError: They are none; what was found and what was expected.
    """
    return _from_json("conditions", content, _CONDITIONS)


def _integers(table: dict[str, Any], key: str) -> NDArray[Any]:
    array = table[key]
    if not isinstance(array, np.ndarray) or array.dtype.kind not in "iu":
        raise ValueError(f"samples: {key} is no array of integers")
    return array


def _from_json(topic: str, content: bytes, kind: TypeAdapter[T]) -> T:
    try:
        return kind.validate_json(content, strict=True)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        raise ValueError(f"{topic}: {problem_from_error(first, ())}") from error
