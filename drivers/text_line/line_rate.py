"""How often a board prints its lines: learned from the first ones, and followed."""

from collections.abc import Sequence
from itertools import pairwise
from statistics import linear_regression, median

from traverse.drivers.text_line.line import Line

LEAST_LINES = 3  # to learn the rate
WINDOW_NS = 1_000_000_000
# In two windows in a row: one alone may be a computer that was busy.
LEAST_CHANGE, LIKE = 1.3, 1.15  # ratio of periods


def first_period_ns(first: Sequence[tuple[Line, int]], tick_ns: float) -> float:
    """Return the time between lines [ns], by the board's time if it prints one.

    ``first`` has successive lines and when each was read [ns].
    """
    steps = [
        (b.ticks - a.ticks) * tick_ns
        for (a, _), (b, _) in pairwise(first)
        if a.ticks is not None and b.ticks is not None and b.ticks > a.ticks
    ]
    if steps:
        return median(steps)
    # Those of the first read may have waited: they say nothing about the rate. Of
    # several that were read together the last one had just arrived.
    arrived = dict[int, int]()  # when read: the number of the last line
    for number, (_, received_ns) in enumerate(first):
        arrived[received_ns] = number
    reads_ns, numbers = list(arrived), list(arrived.values())
    if len(reads_ns) < LEAST_LINES:
        return (reads_ns[-1] - reads_ns[0]) / max(1, numbers[-1] - numbers[0])
    return linear_regression(numbers, reads_ns).slope


class LineRateMonitor:
    """Notices that a board prints faster or slower than it did.

    A board's own time shows it in the time between most of its lines; without one, how
    many lines arrive in a second and more.

    Attributes:
        period_ns: between two lines.
    """

    def __init__(self, period_ns: float, begin_ns: int) -> None:
        self.period_ns = period_ns
        self._other_ns: float | None = None  # of the last window
        self._begin(begin_ns)

    def _begin(self, begin_ns: int) -> None:
        self._begin_ns, self._n_lines = begin_ns, 0
        self._passed_ns: list[float] = []

    def add(self, n_lines: int, passed_ns: float | None) -> None:
        """Add a line.

        Args:
            n_lines: those since the last one that was read, itself included.
            passed_ns: since the last one, by the board's time; None without one.
        """
        self._n_lines += n_lines
        if passed_ns:  # 0: its timer has stopped
            self._passed_ns.append(passed_ns / n_lines)

    def has_changed(self, received_ns: int) -> bool:
        """Return whether the period is another one from now on, after each read."""
        length_ns = received_ns - self._begin_ns
        if length_ns < WINDOW_NS or self._n_lines < LEAST_LINES:
            return False
        timed_ns = self._passed_ns
        period_ns = median(timed_ns) if timed_ns else length_ns / self._n_lines
        self._begin(received_ns)
        other_ns, self._other_ns = self._other_ns, None
        if _ratio(period_ns, self.period_ns) < LEAST_CHANGE:
            return False
        if other_ns is None or _ratio(period_ns, other_ns) > LIKE:
            self._other_ns = period_ns
            return False
        self.period_ns = period_ns
        return True


def _ratio(first_ns: float, second_ns: float) -> float:
    return max(first_ns, second_ns) / max(1.0, min(first_ns, second_ns))
