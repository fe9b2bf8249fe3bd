"""Contacts bounce: an edge counts when the level has held, and belongs to its begin.

The time of an edge is that of the first change away from the level that was known, as
on a controller board: so debouncing delays the message and not the measurement.
"""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class DebouncedEdge:
    """An input went to a new level at ``time_ns`` and stayed there."""

    active: bool
    time_ns: int


class Debounce:
    """One input.

    Args:
        hold_ns: how long a level must hold.
        active: the level at the beginning, which is no edge.
    """

    def __init__(self, hold_ns: int, *, active: bool) -> None:
        self._hold_ns = hold_ns
        self._known = self._level = active
        self._first_ns = self._last_ns = 0
        self._bouncing = False

    def change(self, active: bool, time_ns: int) -> DebouncedEdge | None:
        """Take a change; the edge of before, if that has held until now."""
        held = self.settle(time_ns)
        if active == self._level:
            return held  # a change was lost between; the level tells all the same
        if not self._bouncing:
            self._first_ns, self._bouncing = time_ns, True
        self._level, self._last_ns = active, time_ns
        return held

    def settle(self, now_ns: int) -> DebouncedEdge | None:
        """An edge whose level has held until now."""
        if not self._bouncing or now_ns - self._last_ns < self._hold_ns:
            return None
        self._bouncing = False
        if self._level == self._known:
            return None  # it was a glitch
        self._known = self._level
        return DebouncedEdge(self._level, self._first_ns)

    @property
    def due_ns(self) -> int | None:
        """When to look again, if nothing changes until then."""
        return self._last_ns + self._hold_ns if self._bouncing else None
