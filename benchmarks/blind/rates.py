"""Rates of yes and no over runs, with what they should be."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from benchmarks.blind.baselines import BASELINES
from benchmarks.blind.outcomes import Line
from benchmarks.proofs.statistics import binomial_interval

# Of the intervals.
LEVEL = 0.95
# None: the run has no answer and does not count.
Question = Callable[[Line], bool | None]


@dataclass(frozen=True, slots=True)
class Row:
    """A line of the table.

    Attributes:
        what: Is counted.
        figure: That the issue asks for, in words.
        n: Of runs, or of what is counted in them.
        found: The rate or ratio.
        interval: Of 95 %.
        holds: The interval contains the figure, or is better.
        rivals: Their rates, None where the question makes no sense for them.
    """

    what: str
    figure: str
    n: int
    found: float
    interval: tuple[float, float]
    holds: bool
    baselines: tuple[float | None, ...] = (None,) * len(BASELINES)

    @property
    def text(self) -> str:
        """As a line of a table."""
        low, high = self.interval
        theirs = " | ".join("" if r is None else f"{r:.0%}" for r in self.baselines)
        return (
            f"| {self.what} | {self.figure} | {self.n} | {self.found:.1%} | "
            f"{low:.1%} to {high:.1%} | {'yes' if self.holds else 'NO'} | {theirs} |"
        )


class Runs:
    """Lines by scenario."""

    def __init__(self, lines: Sequence[Line]) -> None:
        self._lines: dict[str, list[Line]] = {}
        for line in lines:
            self._lines.setdefault(line["scenario"], []).append(line)

    @property
    def names(self) -> list[str]:
        """Of the scenarios."""
        return list(self._lines)

    def of(self, scenario: str) -> list[Line]:
        """Lines of a scenario."""
        return self._lines.get(scenario, [])

    def asked(self, scenarios: Sequence[str], question: Question) -> list[bool]:
        """Collect the answers of all runs of some scenarios."""
        answers = (question(line) for name in scenarios for line in self.of(name))
        return [answer for answer in answers if answer is not None]


def binomial_row(
    what: str,
    answers: Sequence[bool],
    at_least: float | None,
    at_most: float | None,
    baselines: tuple[float | None, ...],
) -> Row:
    """Count the answers of yes, and compare with a figure.

    Args:
        what: Is counted.
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
    return Row(what, figure, n, yes / n, (low, high), holds, baselines)


def share(answers: Sequence[bool]) -> float | None:
    """Say the rate of yes, None without answers."""
    return sum(answers) / len(answers) if answers else None
