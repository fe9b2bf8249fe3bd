"""Values of a parsed file before anything is known about their types."""

import math
from collections.abc import Mapping, Sequence
from typing import Any


def tables_in(value: object) -> list[Mapping[str, Any]]:
    """Take a list of tables; what is not a table counts as an empty one."""
    if not isinstance(value, Sequence) or isinstance(value, str):
        return []
    return [entry if isinstance(entry, Mapping) else {} for entry in value]


def number_in(value: object) -> float | None:
    """Take a finite number, or nothing."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    try:
        number = float(value)
    except OverflowError:
        return None
    return number if math.isfinite(number) else None


def numbers_in(value: object) -> tuple[float, ...] | None:
    """Take a list of finite numbers, or nothing."""
    if not isinstance(value, Sequence) or isinstance(value, str):
        return None
    numbers = tuple(number_in(entry) for entry in value)
    kept = tuple(number for number in numbers if number is not None)
    return kept if len(kept) == len(numbers) else None


def vector_in(value: object) -> tuple[float, ...] | None:
    """Take a list of three finite numbers, or nothing."""
    numbers = numbers_in(value)
    return numbers if numbers is not None and len(numbers) == 3 else None
