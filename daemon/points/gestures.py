"""Presses of one button told apart by their device's time: click, double, hold, long.

    click    released before ``hold_s`` or ``long_s``, and no second press followed
    double   pressed again within ``double_s`` of the release
    hold     still down after ``hold_s``; it ends with the release
    long     still down after ``long_s``

Only gestures that mean something are waited for: where a button knows clicks alone,
each press is a click at once. Every press is decided exactly once; the second of a
double is part of the first. Nothing here knows a clock: time comes with the edges, or
is told to have passed.
"""

from dataclasses import dataclass
from typing import Literal

Gesture = Literal["click", "double", "hold", "long", "part"]


@dataclass(frozen=True, slots=True)
class GestureTimes:
    """What tells gestures apart, in ns."""

    hold_ns: int
    long_ns: int
    double_ns: int


@dataclass(frozen=True, slots=True)
class Decision:
    """What a press was.

    Attributes:
        press: which, counted from 0.
        gesture: what it was, or ``part`` of the one before.
        time_ns: when that was certain, by the device's time.
    """

    press: int
    gesture: Gesture
    time_ns: int


class Button:
    """Follows one button.

    Args:
        meant: gestures that mean something.
        times: what tells them apart.

    Attributes:
        presses: how many there have been.
        held: the press that is a hold and still goes on; None where there is none.
    """

    def __init__(self, meant: frozenset[str], times: GestureTimes) -> None:
        self._double_ns = times.double_ns if "double" in meant else None
        self._still: tuple[Gesture, int] | None = None
        if "hold" in meant:
            self._still = ("hold", times.hold_ns)
        elif "long" in meant:
            self._still = ("long", times.long_ns)
        elif "double" in meant:  # what stays down is not waited for for ever
            self._still = ("click", times.long_ns)
        self.presses = 0
        self.held: int | None = None
        self._down_ns: int | None = None  # of the press that is not decided
        self._up_ns: int | None = None  # of its release

    @property
    def due_ns(self) -> int | None:
        """When time alone decides something; None where an edge has to."""
        if self._down_ns is None:
            return None
        if self._up_ns is not None:
            return self._up_ns + (self._double_ns or 0)
        return None if self._still is None else self._down_ns + self._still[1]

    def edge(self, active: bool, time_ns: int) -> list[Decision]:
        """The button went down or up."""
        decided = self.passed(time_ns - 1)
        if not active:
            self.held = None
            if self._down_ns is not None and self._up_ns is None:
                if self._still is not None and self.due_ns == time_ns:
                    return [*decided, self._decided(self._still[0], time_ns)]
                self._up_ns = time_ns
                if self._double_ns is None:
                    decided.append(self._decided("click", time_ns))
            return decided
        press, self.presses = self.presses, self.presses + 1
        self.held = None
        if self._down_ns is not None:
            if self._up_ns is not None:
                decided.append(self._decided("double", time_ns))
                return [*decided, Decision(press, "part", time_ns)]
            # The release between was lost: nobody knows whether it was a double, and
            # a point too many is better than one too few.
            decided.append(self._decided("click", time_ns))
        self._open, self._down_ns, self._up_ns = press, time_ns, None
        if self._still is None and self._double_ns is None:
            decided.append(self._decided("click", time_ns))
        return decided

    def passed(self, time_ns: int) -> list[Decision]:
        """All edges until some time, itself included, have been told."""
        due_ns = self.due_ns
        if due_ns is None or time_ns < due_ns:
            return []
        if self._up_ns is not None or self._still is None:
            return [self._decided("click", due_ns)]
        decision = self._decided(self._still[0], due_ns)
        if decision.gesture == "hold":
            self.held = decision.press
        return [decision]

    def _decided(self, gesture: Gesture, time_ns: int) -> Decision:
        self._down_ns = self._up_ns = None
        return Decision(self._open, gesture, time_ns)
