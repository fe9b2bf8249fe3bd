"""Which messages the broker has, until the database knows, too."""

from collections.abc import Callable

Range = tuple[int, int]


class AckBuffer:
    """Collects numbers, as ranges: answers come nearly in order.

    Args:
        write: sends ranges to the database; told None when they are there, or why not.
    """

    def __init__(
        self, write: Callable[[list[Range], Callable[[object], None]], None]
    ) -> None:
        self._write = write
        self._ranges: list[Range] = []
        self._is_writing = False

    def add(self, number: int) -> None:
        """The broker has this one."""
        if self._ranges and self._ranges[-1][1] == number - 1:
            self._ranges[-1] = self._ranges[-1][0], number
        else:
            self._ranges.append((number, number))

    def flush(self) -> None:
        """Have written what has been collected, if nothing is being written."""
        if self._is_writing or not self._ranges:
            return
        ranges, self._ranges = self._ranges, []
        self._is_writing = True

        def told(outcome: object) -> None:
            self._is_writing = False
            if isinstance(outcome, Exception):  # again later; until then they are here
                self._ranges = _joined(ranges + self._ranges)

        self._write(ranges, told)


def _joined(ranges: list[Range]) -> list[Range]:
    """The same numbers in as few ranges as possible."""
    joined: list[Range] = []
    for first, last in sorted(ranges):
        if joined and first <= joined[-1][1] + 1:
            joined[-1] = joined[-1][0], max(last, joined[-1][1])
        else:
            joined.append((first, last))
    return joined
