"""The score table: found and hidden effects, beside the rivals."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.blind.baselines import BASELINES
from benchmarks.blind.score import pooled_gap
from benchmarks.proofs.statistics import binomial_interval
from benchmarks.trials.lines import Line

# Of the intervals.
LEVEL = 0.95
# None: the run has no answer and does not count.
Question = Callable[[Line], bool | None]


@dataclass(frozen=True, slots=True)
class Row:
    """A line of the table.

    Attributes:
        n: number of runs, or of counted objects in them.
        interval: of 95 %.
        holds: the interval contains the figure, or is better.
        baselines: their rates, None for a question without meaning for them.
    """

    label: str
    figure: str
    n: int
    share: float
    interval: tuple[float, float]
    holds: bool
    baselines: tuple[float | None, ...] = (None,) * len(BASELINES)

    @property
    def text(self) -> str:
        low, high = self.interval
        rates = " | ".join("" if r is None else f"{r:.0%}" for r in self.baselines)
        return (
            f"| {self.label} | {self.figure} | {self.n} | {self.share:.1%} | "
            f"{low:.1%} to {high:.1%} | {'yes' if self.holds else 'NO'} | {rates} |"
        )


class Runs:
    """Lines by scenario."""

    def __init__(self, lines: Sequence[Line]) -> None:
        self._lines: dict[str, list[Line]] = {}
        for line in lines:
            self._lines.setdefault(line["scenario"], []).append(line)

    @property
    def names(self) -> list[str]:
        return list(self._lines)

    def of(self, scenario: str) -> list[Line]:
        return self._lines.get(scenario, [])

    def answers(self, scenarios: Sequence[str], question: Question) -> list[bool]:
        answers = (question(line) for name in scenarios for line in self.of(name))
        return [answer for answer in answers if answer is not None]


def binomial_row(
    label: str,
    answers: Sequence[bool],
    at_least: float | None,
    at_most: float | None,
    baselines: tuple[float | None, ...],
) -> Row:
    """Count the answers of yes, and compare with a figure.

    Args:
        label: Is counted.
        answers: At least one.
        at_least: The figure, or None.
        at_most: The figure where there is no least one.
        baselines: Their rates.
    """
    n, yes = len(answers), sum(answers)
    low, high = binomial_interval(yes, n, LEVEL)
    if at_least is not None:
        holds, figure = high >= at_least, f">= {at_least:.0%}"
    else:
        most = at_most or 0.0
        holds, figure = low <= most, f"<= {most:.0%}"
    return Row(label, figure, n, yes / n, (low, high), holds, baselines)


def share(answers: Sequence[bool]) -> float | None:
    """Return the rate of yes, None without answers."""
    return sum(answers) / len(answers) if answers else None


_NORMAL = 1.96
_ALL_SIZES = tuple(f"one at {size}" for size in (6, 8, 10, 14, 20))
HEADER = (
    "| what | figure | runs | found | 95 % interval | holds | "
    + " | ".join(BASELINES)
    + " |\n"
    + "|---" * (6 + len(BASELINES))
    + "|"
)


def rows(lines: Sequence[Line]) -> Iterator[Row]:
    """Yield the rows of the table; rows without runs are left out.

    Args:
        lines: of all runs; broken ones count as nothing found.
    """
    runs = Runs(lines)

    def row(
        label: str,
        names: Sequence[str],
        question: Question,
        *,
        at_least: float | None = None,
        at_most: float | None = None,
        rival: str | None = None,
    ) -> Iterator[Row]:
        answers = runs.answers(names, question)
        if not answers:
            return
        baselines = tuple(
            share(runs.answers(names, _of_rival(rival_name, rival)))
            for rival_name in BASELINES
        )
        yield binomial_row(label, answers, at_least, at_most, baselines)

    for name, most in zip(
        ("noise known", "noise 1.4 x stated", "noise serial"),
        (0.01, 0.02, 0.03),
        strict=True,
    ):
        of = f"clean, {name}"
        detected = _score("detected")
        yield from row(
            f"false alarms, {name}", [of], detected, at_most=most, rival="detected"
        )
    for label, key, figures, rival in (
        ("detection", "detected", {6: 0.95, 8: 0.99}, "detected"),
        ("exact name", "exact", {6: 0.85, 8: 0.93, 10: 0.95, 14: 0.97}, "exact"),
        ("right joint", "right_joint", {6: 0.95, 8: 0.98}, None),
    ):
        for size, least in figures.items():
            of = f"one at {size}"
            yield from row(
                f"{label} at {size}", [of], _score(key), at_least=least, rival=rival
            )
    yield from row(
        "truth in the set",
        _ALL_SIZES,
        _score_where("detected", "in_set"),
        at_least=0.97,
    )
    yield from row(
        "single name right", _ALL_SIZES, _score_where("single", "exact"), at_least=0.99
    )
    for size, least in {6: 0.65, 8: 0.80, 10: 0.85, 14: 0.90}.items():
        of = f"two at {size}"
        yield from row(
            f"exact pair at {size}",
            [of],
            _score("all_exact"),
            at_least=least,
            rival="all_exact",
        )
    yield from _worse_with_blunders(runs)
    for size, most, least in ((10, 0.05, 0.85), (15, 0.01, 0.97)):
        outside = [f"outside at {size}"]
        yield from row(
            f"outside, wrong name, at {size}",
            outside,
            _score("confident_wrong"),
            at_most=most,
            rival="named",
        )
        yield from row(
            f"outside, right joint, at {size}",
            outside,
            _score("right_joint"),
            at_least=least,
        )
    for size, least in ((10, 0.90), (20, 0.97)):
        yield from _gap(size, runs.of(f"one at {size}"), least)
    yield from _deviations(lines)
    yield from row("false unknown, inside", _ALL_SIZES, _score("unknown"), at_most=0.02)
    yield from row("runs that broke", runs.names, _broke, at_most=0.0)


def _score(key: str) -> Question:
    return lambda line: bool(line["score"][key]) if line.get("score") else False


def _score_where(condition: str, key: str) -> Question:
    return lambda line: (
        bool(line["score"][key])
        if line.get("score") and line["score"][condition]
        else None
    )


def _broke(line: Line) -> bool:
    return line["error"] is not None


def _of_rival(name: str, question: str | None) -> Question:
    def answer_of(line: Line) -> bool | None:
        answer = (line.get("rivals") or {}).get(name)
        if answer is None or question is None:
            return None
        if name == "overall test" and question != "detected":
            return None  # it has no names
        return bool(answer["detected" if question == "named" else question])

    return answer_of


def _worse_with_blunders(runs: Runs) -> Iterator[Row]:
    exact = _score("exact")
    plain = {line["seed"]: bool(exact(line)) for line in runs.of("one at 8")}
    for part in ("2%", "5%"):
        spoilt = runs.of(f"one at 8, {part} blunders")
        worse = np.array(
            [
                plain[s["seed"]] - float(exact(s) or 0)
                for s in spoilt
                if s["seed"] in plain
            ]
        )
        if len(worse) < 2:
            continue
        mean = float(np.mean(worse))
        # Where no run differs, a single one might have: Laplace's rule.
        spread = max(float(np.std(worse)), 1.0 / len(worse)) / np.sqrt(len(worse))
        interval = (mean - _NORMAL * spread, mean + _NORMAL * spread)
        label = f"exact name at 8 lost by {part} blunders"
        holds = interval[0] <= 0.03
        yield Row(label, "<= 3 points", len(worse), mean, interval, holds)


def _gap(size: int, lines: Sequence[Line], least: float) -> Iterator[Row]:
    gaps = [tuple(line["gap"]) for line in lines if line.get("gap")]
    pooled = pooled_gap(gaps)
    if pooled is None or len(gaps) < 2:
        return
    without = [
        pooled_gap(gaps[:number] + gaps[number + 1 :]) for number in range(len(gaps))
    ]
    left = np.array([gap for gap in without if gap is not None])
    spread = float(np.sqrt((len(left) - 1) * np.var(left)))
    interval = (pooled - _NORMAL * spread, pooled + _NORMAL * spread)
    label = f"gap closed at {size}, pooled against the oracle"
    yield Row(
        label, f">= {least:.0%}", len(gaps), pooled, interval, interval[1] >= least
    )


def _deviations(lines: Sequence[Line]) -> Iterator[Row]:
    sizes = [
        abs(deviation)
        for line in lines
        if line.get("score") and not line["scenario"].startswith("outside")
        for deviation in line["score"]["deviations"]
    ]
    if not sizes:
        return
    inside = sum(deviation <= 2.0 for deviation in sizes)
    low, high = binomial_interval(inside, len(sizes), LEVEL)
    yield Row(
        "parameters within two sigma",
        "93 to 97 %",
        len(sizes),
        inside / len(sizes),
        (low, high),
        low <= 0.97 and high >= 0.93,
    )
