"""Results as plain values, as reports in JSON have them."""

import math
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np


def plain_values(value: Any) -> Any:  # noqa: ANN401 - as of json
    """Write dataclasses as tables, arrays as lists, infinity and NaN as None."""
    if is_dataclass(value):
        return {f.name: plain_values(getattr(value, f.name)) for f in fields(value)}
    if isinstance(value, Mapping):
        return {key: plain_values(one) for key, one in value.items()}
    if isinstance(value, np.ndarray):
        return plain_values(value.tolist())
    if isinstance(value, list | tuple):
        return [plain_values(one) for one in value]
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    return value


def picked(value: object, *names: str, **renamed: str) -> dict[str, Any]:
    """Take attributes of a value as plain values; renamed ones by their new names."""
    attributes = dict(zip(names, names, strict=True)) | renamed
    return {key: plain_values(getattr(value, n)) for key, n in attributes.items()}
