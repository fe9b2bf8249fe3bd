"""Results as plain values, as reports in JSON have them, and how they differ."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from traverse.strict_toml.problems import shown


def plain_values(value: Any) -> Any:  # noqa: ANN401 - as of json
    """Write dataclasses as tables, arrays as lists, infinity and NaN as None."""
    if is_dataclass(value):
        return {f.name: plain_values(getattr(value, f.name)) for f in fields(value)}
    if isinstance(value, Mapping):
        return {key: plain_values(entry) for key, entry in value.items()}
    if isinstance(value, np.ndarray):
        return plain_values(value.tolist())
    if isinstance(value, list | tuple):
        return [plain_values(entry) for entry in value]
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    return value


def picked(value: object, *names: str, **renamed: str) -> dict[str, Any]:
    """Take attributes of a value as plain values; renamed ones by their new names."""
    attributes = dict(zip(names, names, strict=True)) | renamed
    return {key: plain_values(getattr(value, n)) for key, n in attributes.items()}


# A nanometre of a metre, and what processors differ by.
_RELATIVE, _ABSOLUTE = 1e-6, 1e-9


def differences(stated: object, again: object, where: str = "") -> Iterator[str]:
    """Name every value that differs, by its path; numbers but for rounding."""
    if isinstance(stated, Mapping) and isinstance(again, Mapping):
        for key in dict.fromkeys([*stated, *again]):
            inner = f"{where}.{key}" if where else str(key)
            if key not in stated or key not in again:
                yield f"{inner}: only the {'data' if key in again else 'result'} has it"
            else:
                yield from differences(stated[key], again[key], inner)
    elif isinstance(stated, list | tuple) and isinstance(again, list | tuple):
        if len(stated) != len(again):
            yield f"{where}: the data give {len(again)}, the result has {len(stated)}"
            return
        for at, (entry, other) in enumerate(zip(stated, again, strict=True)):
            name = entry.get("name", at) if isinstance(entry, Mapping) else at
            yield from differences(entry, other, f"{where}[{name}]")
    elif not _agree(stated, again):
        message = f"the data give {shown(again)}, the result states {shown(stated)}"
        yield f"{where}: {message}"


def _agree(stated: object, again: object) -> bool:
    if isinstance(stated, bool) or isinstance(again, bool):
        return stated is again
    if isinstance(stated, int | float) and isinstance(again, int | float):
        return abs(stated - again) <= _ABSOLUTE + _RELATIVE * abs(again)
    return stated == again
