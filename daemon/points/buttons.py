"""From presses of buttons to gestures and actions, with presses not yet decided."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from traverse.arrays import Booleans, Integers
from traverse.daemon.config.schema import Action, CaptureSection
from traverse.drivers.base.values import CountSamples

EDGE_DELAY_NS = 50_000_000  # an edge may be under way for so long
LOST_EDGE_NS = 3_000_000_000  # of one that streamed levels show and that never comes

Gesture = Literal["click", "double", "hold", "long", "part"]


@dataclass(frozen=True, slots=True)
class GestureTimes:
    """Times that distinguish gestures, in ns."""

    hold_ns: int
    long_ns: int
    double_ns: int


@dataclass(frozen=True, slots=True)
class GestureDecision:
    """Decision about a press.

    Attributes:
        press: its number, from 0.
        gesture: its gesture, or ``part`` of the one before.
        time_ns: when that was certain, by the device's time.
    """

    press: int
    gesture: Gesture
    time_ns: int


class GestureDetector:
    """Detect the gestures of one button."""

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

    def lacks_edge(self, levels: "StreamedLevels") -> bool:
        """Return whether streamed levels show an edge that has not come."""
        is_down = self._up_ns is None
        edge_ns = self._down_ns if is_down else self._up_ns
        other_ns = levels.inactive_ns if is_down else levels.active_ns
        # Until then a contact may bounce.
        return edge_ns is not None and other_ns > edge_ns + EDGE_DELAY_NS

    def edge(self, active: bool, time_ns: int) -> list[GestureDecision]:
        decided = self.passed(time_ns - 1)
        if not active:
            if self._down_ns is not None and self._up_ns is None:
                if self._still is not None and self.due_ns == time_ns:
                    return [*decided, self._decided(self._still[0], time_ns)]
                self._up_ns = time_ns
                if self._double_ns is None:
                    decided.append(self._decided("click", time_ns))
            return decided
        press, self.presses = self.presses, self.presses + 1
        if self._down_ns is not None:
            if self._up_ns is not None:
                decided.append(self._decided("double", time_ns))
                return [*decided, GestureDecision(press, "part", time_ns)]
            # The release between was lost: it may have been a double, and
            # a point too many is better than one too few.
            decided.append(self._decided("click", time_ns))
        self._open, self._down_ns, self._up_ns = press, time_ns, None
        if self._still is None and self._double_ns is None:
            decided.append(self._decided("click", time_ns))
        return decided

    def passed(self, time_ns: int) -> list[GestureDecision]:
        """Decide as far as possible when all edges until this time are known."""
        due_ns = self.due_ns
        if due_ns is None or time_ns < due_ns:
            return []
        if self._up_ns is not None or self._still is None:
            return [self._decided("click", due_ns)]
        return [self._decided(self._still[0], due_ns)]

    def _decided(self, gesture: Gesture, time_ns: int) -> GestureDecision:
        self._down_ns = self._up_ns = None
        return GestureDecision(self._open, gesture, time_ns)


@dataclass(slots=True)
class StreamedLevels:
    """What the samples of a stream last showed of an input.

    Attributes:
        last_ns: time of the last sample; 0 without a stream.
        inactive_ns, active_ns: when the input was last seen so.
    """

    last_ns: int = 0
    inactive_ns: int = 0
    active_ns: int = 0

    def add(self, times_ns: Integers, is_active: Booleans) -> None:
        """Note levels (n,) of successive samples."""
        self.last_ns = int(times_ns[-1])
        if is_active.any():
            self.active_ns = int(times_ns[is_active][-1])
        if not is_active.all():
            self.inactive_ns = int(times_ns[~is_active][-1])


GestureActions = Mapping[str, Action]
Input = tuple[str, int]


@dataclass(slots=True, eq=False)
class Press:
    """One press of a button.

    Attributes:
        gesture, action: None while undecided.
    """

    gesture: Gesture | None = None
    action: Action | None = None


class ButtonTracker:
    """Follow all buttons of the configuration.

    Strategy: time decides a gesture only where no edge is missing. A board keeps edges
    while its clock is in doubt, and a busy computer reads late; the levels that come
    with its samples show both, if it streams.

    Args:
        meanings: actions of gestures by input; others capture at each press.
    """

    def __init__(
        self,
        meanings: Mapping[Input, GestureActions],
        times: GestureTimes | None = None,
    ) -> None:
        self._meanings = dict(meanings)
        self._times = times or GestureTimes(0, 0, 0)
        self._buttons: dict[Input, GestureDetector] = {}
        self._open: dict[tuple[Input, int], Press] = {}
        self._held: dict[Input, Press] = {}
        self._levels = {
            which: StreamedLevels()
            for which, actions in self._meanings.items()
            if set(actions) - {"click"}
        }

    @property
    def all_decided(self) -> bool:
        return not self._open and not self._held

    def down(self, which: Input, time_ns: int) -> Press:
        button = self._button(which)
        press = self._open[which, button.presses] = Press()
        self._held.pop(which, None)
        self._decide(which, button.edge(True, time_ns))
        return press

    def up(self, which: Input, time_ns: int) -> Press | None:
        """Process the release of a button; return the hold that it ends, if any."""
        self._decide(which, self._button(which).edge(False, time_ns))
        return self._held.pop(which, None)

    def follow_levels(self, samples: CountSamples) -> None:
        """Note what the samples of a device show of its buttons."""
        for (device, number), levels in self._levels.items():
            if device == samples.device:
                is_active = (samples.inputs >> number & 1).astype(np.bool_)
                levels.add(samples.sample_time_ns, is_active)

    def passed(self, now_ns: int) -> None:
        """Decide presses that no later edge can change."""
        for which, button in self._buttons.items():
            due_ns = button.due_ns
            if due_ns is None:
                continue
            until_ns = now_ns - EDGE_DELAY_NS
            levels = self._levels.get(which)
            if levels is not None and until_ns < due_ns + LOST_EDGE_NS:
                if button.lacks_edge(levels):
                    continue
                until_ns = min(until_ns, levels.last_ns or until_ns)
            self._decide(which, button.passed(until_ns))

    def _meant(self, which: Input) -> GestureActions:
        return self._meanings.get(which, {"click": "point"})

    def _button(self, which: Input) -> GestureDetector:
        button = self._buttons.get(which)
        if button is None:
            meant = frozenset(self._meant(which))
            button = self._buttons[which] = GestureDetector(meant, self._times)
        return button

    def _decide(self, which: Input, decisions: list[GestureDecision]) -> None:
        for decision in decisions:
            press = self._open.pop((which, decision.press))
            press.gesture = decision.gesture
            press.action = self._meant(which).get(decision.gesture, "none")
            if decision.gesture == "hold":
                self._held[which] = press


def buttons_of(settings: CaptureSection) -> ButtonTracker:
    times = GestureTimes(
        int(settings.hold_s * 1e9),
        int(settings.long_s * 1e9),
        int(settings.double_s * 1e9),
    )
    return ButtonTracker(
        {(i.device_id, i.number): i.gesture_actions for i in settings.inputs}, times
    )
