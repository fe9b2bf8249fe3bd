"""Prometheus' text format, version 0.0.4: families of samples with labels."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Literal

CONTENT_TYPE = "text/plain; version=0.0.4; charset=utf-8"

Labels = Mapping[str, str]


def family(
    name: str,
    kind: Literal["counter", "gauge"],
    text: str,
    samples: Iterable[tuple[Labels, float]],
) -> str:
    """One family; empty without samples.

    Args:
        name: with its unit, and `_total` for a counter.
        kind: a counter only grows.
        text: what it is, for people.
        samples: labels and value of each.
    """
    lines = [f"{name}{_labels(labels)} {_number(value)}" for labels, value in samples]
    return "\n".join([*_head(name, kind, text), *lines, ""]) if lines else ""


def histogram(
    name: str,
    text: str,
    bounds: Sequence[float],
    samples: Iterable[tuple[Labels, Sequence[int], float]],
) -> str:
    """One family of histograms.

    Args:
        name: with its unit.
        text: what it is, for people.
        bounds: upper bounds of the bins but the last.
        samples: labels, how many lie in each bin, and the sum of all.
    """
    lines = []
    for labels, counts, total in samples:
        below = 0
        for bound, count in zip([*bounds, float("inf")], counts, strict=True):
            below += count
            limits = {**labels, "le": _number(bound)}
            lines.append(f"{name}_bucket{_labels(limits)} {below}")
        lines.append(f"{name}_sum{_labels(labels)} {_number(total)}")
        lines.append(f"{name}_count{_labels(labels)} {below}")
    return "\n".join([*_head(name, "histogram", text), *lines, ""]) if lines else ""


def _head(name: str, kind: str, text: str) -> tuple[str, str]:
    escaped = text.replace("\\", "\\\\").replace("\n", "\\n")
    return f"# HELP {name} {escaped}", f"# TYPE {name} {kind}"


def _labels(labels: Labels) -> str:
    if not labels:
        return ""
    told = ",".join(f'{name}="{_escaped(value)}"' for name, value in labels.items())
    return f"{{{told}}}"


def _escaped(value: str) -> str:
    return value.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")


def _number(value: float) -> str:
    """As Prometheus writes it: +Inf, and whole numbers without a point."""
    if value == float("inf"):
        return "+Inf"
    return str(int(value)) if float(value).is_integer() else repr(float(value))
