"""What would have been seen, as tables: effects down, joints across."""

from collections.abc import Sequence

from lab.diagnosis.candidate import Candidate
from lab.diagnosis.diagnosis import Detectable
from lab.diagnosis.report.names import minimum_in_words, name_in_words, quantity

NOT_SEEN = "—"


def joint_rows(
    detectable: Sequence[Detectable], joint_names: Sequence[str]
) -> list[list[str]]:
    """List the effects of joints, a column a joint."""
    found: dict[str, dict[str, str]] = {}
    for entry in detectable:
        candidate = entry.candidate
        if candidate.joint is None:
            continue
        row = found.setdefault(_without_joint(candidate), {})
        seen = entry.minimum is not None
        row[candidate.joint] = minimum_in_words(entry) if seen else NOT_SEEN
    return [
        [name, *(row.get(joint, "") for joint in joint_names)]
        for name, row in found.items()
    ]


def whole_arm_rows(detectable: Sequence[Detectable]) -> list[list[str]]:
    """List the effects of the whole arm: what, from which size on, at the probe."""
    return [
        [
            name_in_words(entry.candidate),
            NOT_SEEN if entry.minimum is None else minimum_in_words(entry),
            "" if entry.minimum is None else quantity(entry.probe_mm, None, "mm"),
        ]
        for entry in detectable
        if entry.candidate.joint is None
    ]


def reasons(detectable: Sequence[Detectable]) -> list[str]:
    """Say why effects cannot be seen at all, those of one reason together."""
    by_reason: dict[str, list[str]] = {}
    for entry in detectable:
        if entry.minimum is None:
            names = by_reason.setdefault(entry.why or "no reason given", [])
            names.append(name_in_words(entry.candidate))
    return [f"{why}: {'; '.join(names)}" for why, names in by_reason.items()]


def detectable_lines(detectable: Sequence[Detectable]) -> list[str]:
    """List everything, a line an effect, for terminals."""
    names = [name_in_words(entry.candidate) for entry in detectable]
    width = max((len(name) for name in names), default=0)
    lines = []
    for name, entry in zip(names, detectable, strict=True):
        if entry.minimum is None:
            lines.append(f"{name:<{width}}  cannot be seen: {entry.why}")
        else:
            lines.append(
                f"{name:<{width}}  from {minimum_in_words(entry)} on "
                f"({quantity(entry.probe_mm, None, 'mm')} at the probe)"
            )
    return lines


def _without_joint(candidate: Candidate) -> str:
    return name_in_words(candidate).removesuffix(f", joint {candidate.joint}")
