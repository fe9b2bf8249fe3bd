"""Conversion of deliveries to maps of plain values and arrays, for recordings."""

from collections.abc import Mapping
from dataclasses import fields
from functools import cache
from typing import Any

import numpy as np
from pydantic import TypeAdapter, ValidationError

from traverse.drivers.base.values import (
    CountSamples,
    Delivery,
    DeviceAlarm,
    DeviceClockState,
    DeviceCounters,
    DeviceFault,
    DeviceLost,
    DeviceTemperatures,
    DeviceUp,
    LatchedCounts,
    RepeatedCount,
    StreamStarted,
)

KINDS: dict[str, type[Delivery]] = {
    "samples": CountSamples,
    "latch": LatchedCounts,
    "stream": StreamStarted,
    "up": DeviceUp,
    "lost": DeviceLost,
    "alarm": DeviceAlarm,
    "fault": DeviceFault,
    "repeated": RepeatedCount,
    "temperatures": DeviceTemperatures,
    "clock": DeviceClockState,
    "counters": DeviceCounters,
}
_FIELDS = {kind: tuple(f.name for f in fields(kind)) for kind in KINDS.values()}
_NAMES = {kind: name for name, kind in KINDS.items()}
_ARRAYS: dict[str, tuple[str, int]] = {
    "seq": ("int64", 1),
    "device_ticks": ("int64", 1),
    "sample_time_ns": ("int64", 1),
    "inputs": ("uint8", 1),
    "counts": ("uint32", 2),
    "status": ("uint8", 2),
    "skew_ns": ("int32", 2),
    "skew_bound_ns": ("int32", 2),
}
_OPTIONAL = {"skew_ns", "skew_bound_ns"}
"""Dtype and number of dimensions of samples' arrays."""


def delivery_kind(delivery: Delivery) -> str:
    return _NAMES[type(delivery)]


def delivery_to_map(delivery: Delivery) -> dict[str, object]:
    table: dict[str, object] = {"kind": delivery_kind(delivery)}
    for name in _FIELDS[type(delivery)]:
        value = getattr(delivery, name)
        if name == "identity":
            value = {f.name: getattr(value, f.name) for f in fields(value)}
        table[name] = value
    return table


def delivery_from_map(table: Mapping[str, Any]) -> Delivery:
    """Read a delivery from a map; unknown keys are ignored.

    Raises:
        ValueError: it is not one.
    """
    name = table.get("kind")
    kind = KINDS.get(name) if isinstance(name, str) else None
    if kind is None:
        raise ValueError(f"a delivery of kind {name!r}, expected {', '.join(KINDS)}")
    known = {name: table[name] for name in _FIELDS[kind] if name in table}
    if kind is CountSamples:
        return _samples(known)
    try:
        delivery: Delivery = _adapter(name).validate_python(known)
    except ValidationError as error:
        raise ValueError(f"a delivery {name!r} that is none: {error}") from error
    return delivery


@cache
def _adapter(name: str) -> TypeAdapter[Any]:
    return TypeAdapter(KINDS[name])


def _samples(known: dict[str, Any]) -> CountSamples:
    counts = known.get("counts")
    if not isinstance(counts, np.ndarray) or counts.ndim != 2 or not len(counts):
        raise ValueError("samples: counts are no array of two dimensions, not empty")
    values: dict[str, Any] = {}
    for name in ("device", "stream", "received_ns"):
        expected = str if name == "device" else int
        if not isinstance(known.get(name), expected):
            raise ValueError(f"samples: {name} is {known.get(name)!r}")
        values[name] = known[name]
    for name, (dtype, dimensions) in _ARRAYS.items():
        array = known.get(name)
        if name in _OPTIONAL and array is None:
            continue
        shape = counts.shape[:dimensions]
        if not isinstance(array, np.ndarray) or array.shape != shape:
            raise ValueError(f"samples: {name} is no array of shape {shape}")
        if array.dtype != np.dtype(dtype):
            raise ValueError(f"samples: {name} is of {array.dtype}, expected {dtype}")
        values[name] = array
    bound_ns = known.get("time_bound_ns", 0)
    if not isinstance(bound_ns, int):
        raise ValueError(f"samples: time_bound_ns is {bound_ns!r}")
    return CountSamples(**values, time_bound_ns=bound_ns)
