"""Prometheus' text format read by its specification, for tests; shares nothing with
what writes it."""

import re
from dataclasses import dataclass, field

NAME = r"[a-zA-Z_:][a-zA-Z0-9_:]*"
LABEL = r'([a-zA-Z_][a-zA-Z0-9_]*)="((?:[^"\\\n]|\\[\\"n])*)"'
SAMPLE = re.compile(rf"({NAME})(?:\{{((?:{LABEL},?)*)\}})? (\S+)")
ESCAPES = {"\\\\": "\\", '\\"': '"', "\\n": "\n"}

Key = tuple[str, frozenset[tuple[str, str]]]


@dataclass
class Family:
    """One metric: its type, what it is, and its samples by name and labels."""

    kind: str
    text: str
    samples: dict[Key, float] = field(default_factory=dict)


def read(text: str) -> dict[str, Family]:
    """All families; an AssertionError where the specification is broken."""
    assert text.endswith("\n")
    families: dict[str, Family] = {}
    explanations, current = {}, ""
    for line in text.splitlines():
        if line.startswith("# HELP "):
            _, _, name, words = line.split(" ", 3)
            assert name not in explanations, f"{name} is explained twice"
            explanations[name] = words
        elif line.startswith("# TYPE "):
            _, _, current, kind = line.split(" ")
            assert kind in ("counter", "gauge", "histogram")
            assert current not in families, f"{current} is in two places"
            families[current] = Family(kind, explanations[current])
        else:
            _take(line, current, families[current])
    for name, family in families.items():
        assert family.samples, f"{name} is empty"
        if family.kind == "counter":
            assert name.endswith("_total")
        if family.kind == "histogram":
            _check(name, family)
    return families


def value(families: dict[str, Family], name: str, **labels: str) -> float:
    base = re.sub(r"_(bucket|sum|count)$", "", name)
    family = families[name] if name in families else families[base]
    return family.samples[name, frozenset(labels.items())]


def _take(line: str, current: str, family: Family) -> None:
    match = SAMPLE.fullmatch(line)
    assert match is not None, line
    name = match[1]
    suffixes = ("_bucket", "_sum", "_count") if family.kind == "histogram" else ("",)
    assert name in {current + suffix for suffix in suffixes}, line
    labels = [
        (key, re.sub(r'\\[\\"n]', lambda match: ESCAPES[match[0]], escaped))
        for key, escaped in re.findall(LABEL, match[2] or "")
    ]
    assert len(dict(labels)) == len(labels), line
    key = name, frozenset(labels)
    assert key not in family.samples, f"{line} is there twice"
    family.samples[key] = float(match[match.lastindex or 0])


def _check(name: str, family: Family) -> None:
    """Buckets grow, end at +Inf, and that is the count."""
    series: dict[frozenset[tuple[str, str]], list[tuple[float, float]]] = {}
    for (sample, labels), number in family.samples.items():
        if sample == f"{name}_bucket":
            bound = float(dict(labels)["le"])
            rest = frozenset(item for item in labels if item[0] != "le")
            series.setdefault(rest, []).append((bound, number))
    for labels, buckets in series.items():
        assert buckets == sorted(buckets)
        counts = [number for _, number in buckets]
        assert counts == sorted(counts)
        assert buckets[-1][0] == float("inf")
        assert family.samples[f"{name}_count", labels] == counts[-1]
        assert (f"{name}_sum", labels) in family.samples
