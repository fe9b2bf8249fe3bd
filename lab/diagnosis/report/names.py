"""Effects and their sizes in words for people, and tables of detectable sizes."""

from collections.abc import Mapping, Sequence

import numpy as np

from traverse.kinematics.effect_table import EFFECT_KINDS, key_unit
from traverse.lab.diagnosis.model.result import Diagnosis
from traverse.lab.outcomes.candidate import Candidate
from traverse.lab.outcomes.diagnosis import Detectable, Estimate, Term
from traverse.lab.report.quantities import often, quantity, shown_unit
from traverse.lab.statistics.outlier_clusters import Cluster

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


def candidate_label(candidate: Candidate) -> str:
    """Return what a candidate is, for example `encoder eccentricity, joint J3`."""
    if candidate.is_curve:
        return _curve(candidate)
    if candidate.covariate == "force_n":
        return "contacts that give way in proportion to the force"
    row = EFFECT_KINDS[candidate.kind]
    label = row.label
    if candidate.joint is None and row.whole_arm_label is not None:
        label = row.whole_arm_label
    text = label.format(
        often=often(candidate.order or 0),
        component=candidate.component,
        artefact=candidate.artefact,
        cycles=candidate.periods,
    )
    of = "" if candidate.joint is None else f", joint {candidate.joint}"
    moment = "" if candidate.at_s is None else f", at {candidate.at_s:.1f} s"
    return f"{text}{of}{moment}"


def _curve(candidate: Candidate) -> str:
    if candidate.artefact is not None and candidate.covariate == "time_s":
        return f"{candidate.artefact} moves in the course of the campaign"
    if candidate.artefact is not None:
        return f"something about {candidate.artefact}"
    over = _covariate(candidate.covariate or "an unknown covariate")
    if candidate.joint is None:
        return f"something over {over} that moves the whole arm"
    moved = _MOVED.get(candidate.component or "angle", str(candidate.component))
    if _may_be_base(candidate):
        moved += ", or the base that it stands on"
    return f"something over {over} that changes joint {candidate.joint} ({moved})"


def _may_be_base(candidate: Candidate) -> bool:
    """Whether a curve tilts an axis by what has nothing to do with that joint."""
    covariate = candidate.covariate or ""
    other = "_approach" in covariate and covariate != f"{candidate.joint}_approach"
    return candidate.component == "tilt" and (other or covariate == "force_n")


def cluster_text(place: Cluster) -> str:
    if place.artefact is not None:
        return f"on {place.artefact}"
    return _range_text(place.covariate, place.low, place.high)


def seen_text(term: Term) -> str:
    seen = term.seen or {"low": float("nan"), "high": float("nan")}
    return _range_text(term.candidate.covariate or "", **seen)


def _range_text(covariate: str, low: float, high: float) -> str:
    unit = _unit(covariate)
    if unit == "rad":
        low, high, unit = np.degrees(low), np.degrees(high), "degrees"
    return f"where {_covariate(covariate)} is {low:.4g} to {high:.4g} {unit}"


def _unit(column: str) -> str:
    ends = {"_rad_s": "rad/s", "_rad": "rad", "_c": "°C", "_s": "s", "_n": "N"}
    return next((unit for end, unit in ends.items() if column.endswith(end)), "")


def _covariate(column: str) -> str:
    """Describe a column of the campaign in words."""
    if column in _COLUMNS:
        return _COLUMNS[column]
    for end, words in _OF_JOINT.items():
        if column.endswith(end):
            return f"the {words} of {column.removesuffix(end)}"
    return column


def moves_base(term: Term) -> bool:
    candidate = term.candidate
    is_of_base = EFFECT_KINDS[candidate.kind].acts_on == "base"
    if candidate.is_curve:
        is_of_base = candidate.joint is None and candidate.artefact is None
    return is_of_base and depends_on_time(term)


def depends_on_time(term: Term) -> bool:
    candidate = term.candidate
    if candidate.is_curve:
        return candidate.covariate == "time_s"
    return "time_s" in EFFECT_KINDS[candidate.kind].covariates


def step_names(diagnosis: Diagnosis) -> list[str]:
    """Name the steps of the ledger."""
    names = ["nothing added"]
    for number, step in enumerate(diagnosis.ledger[1:]):
        # The ledger keeps terms that were taken back later.
        known = len(diagnosis.terms) == len(diagnosis.ledger) - 1
        words = step.effect
        if known:
            term = diagnosis.terms[number]
            words = candidate_label(term.candidate)
            words += "" if term.accepted else " (not in the adapted arm)"
        names.append(f"+ {words}")
    return names


def term_size_text(term: Term) -> str:
    """Return how large a term is, with its standard deviation."""
    size = term_size(term.parameters)
    if size is None:
        return ""
    value, std, unit = size
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
    if any(isinstance(e.value, tuple) and "." in key for key, e in sizes.items()):
        # Curves of several directions.
        ranges = [np.ptp(e.value) for e in sizes.values()]
        return float(np.linalg.norm(ranges)), float(np.sqrt(np.mean(stds**2))), unit
    if "values_rad" in sizes:
        return float(np.ptp(values)), float(np.sqrt(np.mean(stds**2))), unit
    if len(values) == 1:
        return float(values[0]), float(stds[0]), unit
    amplitude = float(np.linalg.norm(values))
    if amplitude == 0.0:
        return 0.0, float(np.linalg.norm(stds)), unit
    return amplitude, float(np.linalg.norm(values * stds) / amplitude), unit


NOT_SEEN = "—"


def joint_rows(
    detectable: Sequence[Detectable], joint_names: Sequence[str]
) -> list[list[str]]:
    """List the effects of joints, a column a joint, each line in its own unit."""
    by_joint: dict[str, dict[str, Detectable]] = {}
    for entry in detectable:
        if entry.candidate.joint is not None:
            row = by_joint.setdefault(_without_joint(entry.candidate), {})
            row[entry.candidate.joint] = entry
    rows = []
    for name, row in by_joint.items():
        seen = [entry.minimum.value for entry in row.values() if entry.minimum]
        unit = key_unit(next(iter(row.values())).key)
        factor, shown = shown_unit(min(seen, default=1.0), unit)
        cells = [_cell(row.get(joint), factor) for joint in joint_names]
        rows.append([f"{name} [{shown}]", *cells])
    return rows


def _cell(entry: Detectable | None, factor: float) -> str:
    if entry is None:
        return ""
    if entry.minimum is None:
        return NOT_SEEN
    size = factor * entry.minimum.value
    return f"{size:.2g}" if size < 100.0 else f"{size:.0f}"


def detectable_lines(detectable: Sequence[Detectable]) -> list[str]:
    """List everything, a line an effect, for terminals."""
    names = [candidate_label(entry.candidate) for entry in detectable]
    width = max((len(name) for name in names), default=0)
    lines = []
    for name, entry in zip(names, detectable, strict=True):
        text = f"cannot be seen: {entry.why}"
        if entry.minimum is not None:
            least = quantity(entry.minimum.value, None, entry.minimum.unit)
            at_probe = quantity(entry.probe_mm, None, "mm")
            text = f"from {least} on ({at_probe} at the probe)"
        lines.append(f"{name:<{width}}  {text}")
    return lines


def _without_joint(candidate: Candidate) -> str:
    return candidate_label(candidate).removesuffix(f", joint {candidate.joint}")
