"""Effects and their sizes in words for people."""

from collections.abc import Mapping

import numpy as np

from traverse.kinematics.effect_table import EFFECT_KINDS
from traverse.lab.diagnosis.model.candidate import Candidate
from traverse.lab.diagnosis.model.outlier_clusters import Cluster
from traverse.lab.diagnosis.model.result import Detectable, Diagnosis, Estimate, Term

_MOVED = {"angle": "its angle", "tilt": "the tilt of its axis", "shift": "its place"}
_COLUMNS = {
    "time_s": "time",
    "temperature_c": "temperature",
    "force_n": "the contact force",
}
_OF_JOINT = {
    "_temperature_c": "temperature",
    "_speed_rad_s": "speed",
    "_approach": "sense of approach",
    "_rad": "reading",
}
# Keys that say where or when, not how much.
_NO_SIZES = ("phase_rad", "at_s")
_PREFIXES = ((1.0, ""), (1e3, "m"), (1e6, "µ"), (1e9, "n"), (1e12, "p"))
_LENGTHS = [(1.0, "mm"), (1e3, "µm"), (1e6, "nm"), (1e9, "pm")]
_BARE = {"ppm": "ppm"}


def candidate_label(candidate: Candidate) -> str:
    """Say what a candidate is, for example `encoder eccentricity, joint J3`."""
    if candidate.is_curve:
        return _curve(candidate)
    row = EFFECT_KINDS[candidate.kind]
    label = row.label
    if candidate.joint is None and row.whole_arm_label is not None:
        label = row.whole_arm_label
    said = label.format(
        often=often(candidate.order or 0),
        component=candidate.component,
        artefact=candidate.artefact,
        cycles=candidate.cycles,
    )
    of = "" if candidate.joint is None else f", joint {candidate.joint}"
    at = "" if candidate.at_s is None else f", at {candidate.at_s:.1f} s"
    return f"{said}{of}{at}"


def often(times: int) -> str:
    """Say how often."""
    return {1: "once", 2: "twice"}.get(times, f"{times} times")


def _curve(candidate: Candidate) -> str:
    if candidate.artefact is not None:
        return f"something about {candidate.artefact}"
    over = _covariate(candidate.covariate or "an unknown covariate")
    if candidate.joint is None:
        return f"something over {over} that moves the whole arm"
    moved = _MOVED.get(candidate.component or "angle", str(candidate.component))
    return f"something over {over} that changes joint {candidate.joint} ({moved})"


def cluster_text(place: Cluster) -> str:
    """Say where poses lie together."""
    if place.artefact is not None:
        return f"on {place.artefact}"
    low, high, unit = place.low, place.high, _unit(place.covariate)
    if unit == "rad":
        low, high, unit = np.degrees(low), np.degrees(high), "degrees"
    return f"where {_covariate(place.covariate)} is {low:.4g} to {high:.4g} {unit}"


def _unit(column: str) -> str:
    """Say the unit that a column's name ends with."""
    ends = {"_rad": "rad", "_rad_s": "rad/s", "_c": "°C", "_s": "s", "_n": "N"}
    return next(
        (ends[end] for end in sorted(ends, key=len)[::-1] if column.endswith(end)), ""
    )


def _covariate(column: str) -> str:
    """Say a column of the campaign in words."""
    if column in _COLUMNS:
        return _COLUMNS[column]
    for end, words in _OF_JOINT.items():
        if column.endswith(end):
            return f"the {words} of {column.removesuffix(end)}"
    return column


def step_names(diagnosis: Diagnosis) -> list[str]:
    """Name the steps of the ledger."""
    found = ["nothing added"]
    for number, step in enumerate(diagnosis.ledger[1:]):
        # The ledger keeps terms that were taken back later.
        known = len(diagnosis.terms) == len(diagnosis.ledger) - 1
        words = step.effect
        if known:
            words = candidate_label(diagnosis.terms[number].candidate)
        found.append(f"+ {words}")
    return found


def term_size_text(term: Term) -> str:
    """Say how large a term is, with its standard deviation."""
    found = term_size(term.estimates)
    if found is None:
        return ""
    value, std, unit = found
    if term.candidate.is_curve:
        return f"{quantity(value, None, unit)} from lowest to highest"
    return quantity(value, std, unit)


def term_size(
    estimates: Mapping[str, Estimate],
) -> tuple[float, float, str] | None:
    """Reduce the keys of an effect to one size, its standard deviation and unit.

    One number stays as it is; of cosine and sine, and of vectors, it is the amplitude;
    of a curve the range.
    """
    sizes = {key: e for key, e in estimates.items() if key not in _NO_SIZES}
    if not sizes:
        return None
    unit = next(iter(sizes.values())).unit
    values = np.concatenate([np.ravel(e.value) for e in sizes.values()]).astype(float)
    stds = np.concatenate([np.ravel(e.std) for e in sizes.values()]).astype(float)
    if "values_rad" in sizes:
        return float(np.ptp(values)), float(np.sqrt(np.mean(stds**2))), unit
    if len(values) == 1:
        return float(values[0]), float(stds[0]), unit
    amplitude = float(np.linalg.norm(values))
    if amplitude == 0.0:
        return 0.0, float(np.linalg.norm(stds)), unit
    return amplitude, float(np.linalg.norm(values * stds) / amplitude), unit


def quantity(value: float, std: float | None, unit: str) -> str:
    """Write a number with its unit: `23.1 ± 1.2 µrad`.

    Args:
        value: In the unit.
        std: Standard deviation, or None.
        unit: A unit of the arm file's keys; a prefix is chosen.
    """
    factor, shown = shown_unit(max(abs(value), 0.0 if std is None else std), unit)
    value = factor * value
    if std is None:
        return f"{value:.3g} {shown}" if abs(value) < 1e3 else f"{value:.0f} {shown}"
    std = factor * std
    digits = _digits(std if std > 0.0 else abs(value))
    return f"{value:.{digits}f} ± {std:.{digits}f} {shown}"


def shown_unit(largest: float, unit: str) -> tuple[float, str]:
    """Choose a prefix so that numbers are short: a factor, and the unit's name."""
    if unit in _BARE:
        return 1.0, unit
    if unit == "1/C":
        return 1e6, "ppm/°C"
    base, slash, per = unit.partition("/")
    per = {"C": "°C", "(N m)": "(N m)"}.get(per, per)
    # Millimetres have a prefix already.
    known = (
        _LENGTHS if base == "mm" else [(f, prefix + base) for f, prefix in _PREFIXES]
    )
    for factor, name in known:
        if factor * largest >= 1.0 or largest == 0.0:
            return factor, f"{name}{slash}{per}"
    factor, name = known[-1]
    return factor, f"{name}{slash}{per}"


def minimal_size_text(entry: Detectable) -> str:
    """Say the smallest size that would have been seen."""
    if entry.minimum is None:
        return "cannot be seen"
    return quantity(entry.minimum, None, entry.unit)


def odds(log_factor: float) -> str:
    """Write a Bayes factor as odds of one to something.

    Args:
        log_factor: Natural logarithm, of the better against the worse.
    """
    decades = log_factor / np.log(10.0)
    if decades < 4.0:
        return f"1:{np.exp(max(log_factor, 0.0)):.0f}"
    return f"1:10^{decades:.0f}"


def p_value_text(log10_p: float) -> str:
    """Write a p-value that may be too small for a number."""
    if log10_p > -4.0:
        return f"p = {10.0**log10_p:.2g}"
    return f"p = 10^{log10_p:.0f}"


def _digits(std: float) -> int:
    """Decimals that show two digits of a standard deviation."""
    if not std > 0.0 or not np.isfinite(std):
        return 1
    return int(np.clip(1 - np.floor(np.log10(std)), 0, 6))
