"""Values in reports: as text, as plain values for JSON, and how these differ."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from traverse.strict_toml.problems import shown

_PREFIXES = ((1.0, ""), (1e3, "m"), (1e6, "µ"), (1e9, "n"), (1e12, "p"))
# Millimetres have a prefix already.
_LENGTHS = ((1.0, "mm"), (1e3, "µm"), (1e6, "nm"), (1e9, "pm"))
_SMALL_PROBABILITY = 1e-4


def number(value: float, spec: str) -> str:
    """Write a number by a format such as `.4f`; nothing for an unknown one."""
    return "" if value is None else format(value, spec)


def millimetres(value_mm: float, expanded_mm: float | None, sign: str = "") -> str:
    """Write a length with the digits that its expanded uncertainty leaves it.

    These are two of the uncertainty (GUM 7.2.6), and at least a tenth of a micrometre;
    nothing for an unknown length.
    """
    digits = max(4, _digits(expanded_mm)) if expanded_mm else 4
    return number(value_mm, f"{sign}.{digits}f")


def quantity(value: float, std: float | None, unit: str) -> str:
    """Write a number with its unit, such as `23.1 ± 1.2 µrad`; a prefix is chosen."""
    factor, shown = shown_unit(max(abs(value), 0.0 if std is None else std), unit)
    value = factor * value
    if std is None:
        return f"{value:.3g} {shown}" if abs(value) < 1e3 else f"{value:.0f} {shown}"
    std = factor * std
    digits = _digits(std if std > 0.0 else abs(value))
    return f"{value:.{digits}f} ± {std:.{digits}f} {shown}"


def shown_unit(largest: float, unit: str) -> tuple[float, str]:
    """Choose a prefix so that numbers are short: a factor, and the unit's name."""
    if unit == "ppm":
        return 1.0, unit
    if unit == "1/C":
        return 1e6, "ppm/°C"
    base, slash, per = unit.partition("/")
    per = {"C": "°C"}.get(per, per)
    known = (
        _LENGTHS if base == "mm" else [(f, prefix + base) for f, prefix in _PREFIXES]
    )
    factor, name = next(
        (step for step in known if step[0] * largest >= 1.0 or largest == 0.0),
        known[-1],
    )
    return factor, f"{name}{slash}{per}"


def length_mm(value_mm: float) -> str:
    """Write a length in mm with three digits, at least micrometres."""
    if not np.isfinite(value_mm):
        return f"{value_mm} mm"
    size = abs(value_mm)
    digits = 4 if size < 1.0 else 3 if size < 100.0 else 1
    if 0.0 < size < 0.001:
        return f"{value_mm:.2g} mm"
    return f"{value_mm:.{digits}f} mm"


def often(times: int) -> str:
    """Write how often: `once`, `twice`, `3 times`."""
    return {1: "once", 2: "twice"}.get(times, f"{times} times")


def probability(p_value: float) -> str:
    if p_value < _SMALL_PROBABILITY:
        return f"below {_SMALL_PROBABILITY:.4f}"
    return f"{p_value:.2g}"


def probability_of_log(log10_p: float) -> str:
    """Write a probability that may be too small for a number."""
    return f"{10.0**log10_p:.2g}" if log10_p > -4.0 else f"10^{log10_p:.0f}"


def odds(log_factor: float) -> str:
    """Write a Bayes factor, natural logarithm, as odds: `40 to 1`."""
    decades = log_factor / np.log(10.0)
    if decades < 4.0:
        return f"{np.exp(max(log_factor, 0.0)):.0f} to 1"
    return f"10^{decades:.0f} to 1"


def _digits(std: float) -> int:
    """Decimals that show two digits of a standard deviation."""
    if not std > 0.0 or not np.isfinite(std):
        return 1
    return int(np.clip(1 - np.floor(np.log10(std)), 0, 6))


OMITTED = {"omitted": True}
"""Metadata of a field of a dataclass that JSON leaves out where it is None."""
HIDDEN = {"hidden": True}
"""Metadata of a field that JSON leaves out."""
INLINED = {"inlined": True}
"""Metadata of a field whose own fields stand in its place in JSON."""


def plain_values(value: Any) -> Any:  # noqa: ANN401 - as of json
    """Write dataclasses as tables, arrays as lists, infinity and NaN as None.

    The metadata of fields may be `OMITTED`, `HIDDEN` or `INLINED`. A class may name
    in `DERIVED` properties that follow; those that are None are left out.
    """
    if is_dataclass(value):
        plain: dict[str, Any] = {}
        for entry in fields(value):
            of_entry = getattr(value, entry.name)
            if entry.metadata.get("inlined"):
                plain |= plain_values(of_entry)
            elif not entry.metadata.get(
                "hidden", of_entry is None and entry.metadata.get("omitted")
            ):
                plain[entry.name] = plain_values(of_entry)
        for name in getattr(value, "DERIVED", ()):
            of_property = getattr(value, name)
            if of_property is not None:
                plain[name] = plain_values(of_property)
        return plain
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
        for index, (entry, other) in enumerate(zip(stated, again, strict=True)):
            name = entry.get("name", index) if isinstance(entry, Mapping) else index
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
