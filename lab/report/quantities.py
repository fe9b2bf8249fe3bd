"""Numbers as text, for reports and terminals: digits, units, odds, probabilities."""

import numpy as np

_PREFIXES = ((1.0, ""), (1e3, "m"), (1e6, "µ"), (1e9, "n"), (1e12, "p"))
# Millimetres have a prefix already.
_LENGTHS = ((1.0, "mm"), (1e3, "µm"), (1e6, "nm"), (1e9, "pm"))
_SMALL_PROBABILITY = 1e-4


def number(value: float, spec: str) -> str:
    """Write a number by a format such as `.4f`; nothing for an unknown one."""
    return "" if value is None else format(value, spec)


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
    """Write a probability."""
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
