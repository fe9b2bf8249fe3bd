"""Minimal detectable sizes, as tables: effects down, joints across."""

from collections.abc import Sequence

from traverse.lab.diagnosis.model.candidate import Candidate
from traverse.lab.diagnosis.model.result import Detectable
from traverse.lab.diagnosis.report.names import candidate_label
from traverse.lab.report.quantities import quantity, shown_unit

NOT_SEEN = "—"


def joint_rows(
    detectable: Sequence[Detectable], joint_names: Sequence[str]
) -> list[list[str]]:
    """List the effects of joints, a column a joint, each line in its own unit."""
    found: dict[str, dict[str, Detectable]] = {}
    for entry in detectable:
        if entry.candidate.joint is not None:
            row = found.setdefault(_without_joint(entry.candidate), {})
            row[entry.candidate.joint] = entry
    rows = []
    for name, row in found.items():
        seen = [entry.minimum for entry in row.values() if entry.minimum is not None]
        unit = next(iter(row.values())).unit
        factor, shown = shown_unit(min(seen, default=1.0), unit)
        cells = [_cell(row.get(joint), factor) for joint in joint_names]
        rows.append([f"{name} [{shown}]", *cells])
    return rows


def _cell(entry: Detectable | None, factor: float) -> str:
    if entry is None:
        return ""
    if entry.minimum is None:
        return NOT_SEEN
    size = factor * entry.minimum
    return f"{size:.2g}" if size < 100.0 else f"{size:.0f}"


def whole_arm_rows(detectable: Sequence[Detectable]) -> list[list[str]]:
    """List the effects of the whole arm: what, from which size on, at the probe."""
    return [
        [
            candidate_label(entry.candidate),
            NOT_SEEN
            if entry.minimum is None
            else quantity(entry.minimum, None, entry.unit),
            "" if entry.minimum is None else quantity(entry.probe_mm, None, "mm"),
        ]
        for entry in detectable
        if entry.candidate.joint is None
    ]


def reasons(detectable: Sequence[Detectable]) -> list[str]:
    """List why effects are undetectable, grouped by reason."""
    by_reason: dict[str, list[str]] = {}
    for entry in detectable:
        if entry.minimum is None:
            names = by_reason.setdefault(entry.why or "no reason given", [])
            names.append(candidate_label(entry.candidate))
    return [f"{why}: {'; '.join(names)}" for why, names in by_reason.items()]


def detectable_lines(detectable: Sequence[Detectable]) -> list[str]:
    """List everything, a line an effect, for terminals."""
    names = [candidate_label(entry.candidate) for entry in detectable]
    width = max((len(name) for name in names), default=0)
    lines = []
    for name, entry in zip(names, detectable, strict=True):
        if entry.minimum is None:
            lines.append(f"{name:<{width}}  cannot be seen: {entry.why}")
        else:
            lines.append(
                f"{name:<{width}}  from {quantity(entry.minimum, None, entry.unit)} on "
                f"({quantity(entry.probe_mm, None, 'mm')} at the probe)"
            )
    return lines


def _without_joint(candidate: Candidate) -> str:
    return candidate_label(candidate).removesuffix(f", joint {candidate.joint}")
