"""What presses mean: gestures to actions, and the presses not yet decided."""

from collections.abc import Mapping
from dataclasses import dataclass

from traverse.daemon.config.schema import Action, CaptureSection
from traverse.daemon.points.gestures import Button, Decision, Gesture, GestureTimes

EDGE_DELAY_NS = 50_000_000  # an edge may be under way for so long

Meanings = Mapping[str, Action]
Input = tuple[str, int]


@dataclass(slots=True, eq=False)
class Press:
    """One press of a button.

    Attributes:
        gesture, action: what it was and what it does; None while that is not decided.
    """

    gesture: Gesture | None = None
    action: Action | None = None


class Buttons:
    """Follows all buttons of the configuration.

    Args:
        meanings: per input, what its gestures do; others capture at each press.
        times: what tells gestures apart.
    """

    def __init__(
        self, meanings: Mapping[Input, Meanings], times: GestureTimes | None = None
    ) -> None:
        self._meanings = dict(meanings)
        self._times = times or GestureTimes(0, 0, 0)
        self._buttons: dict[Input, Button] = {}
        self._open: dict[tuple[Input, int], Press] = {}
        self._held: dict[Input, Press] = {}

    @property
    def all_decided(self) -> bool:
        """No press waits to be told apart, and no hold for its end."""
        return not self._open and not self._held

    def down(self, which: Input, time_ns: int) -> Press:
        """A button was pressed."""
        button = self._button(which)
        press = self._open[which, button.presses] = Press()
        self._held.pop(which, None)
        self._decide(which, button.edge(True, time_ns))
        return press

    def up(self, which: Input, time_ns: int) -> Press | None:
        """A button was released; gives the hold that ends with it, if one does."""
        self._decide(which, self._button(which).edge(False, time_ns))
        return self._held.pop(which, None)

    def passed(self, now_ns: int) -> None:
        """It is later now: decide what no edge can change any more."""
        for which, button in self._buttons.items():
            if button.due_ns is not None:
                self._decide(which, button.passed(now_ns - EDGE_DELAY_NS))

    def _meant(self, which: Input) -> Meanings:
        return self._meanings.get(which, {"click": "point"})

    def _button(self, which: Input) -> Button:
        button = self._buttons.get(which)
        if button is None:
            meant = frozenset(self._meant(which))
            button = self._buttons[which] = Button(meant, self._times)
        return button

    def _decide(self, which: Input, decisions: list[Decision]) -> None:
        for decision in decisions:
            press = self._open.pop((which, decision.press))
            press.gesture = decision.gesture
            press.action = self._meant(which).get(decision.gesture, "none")
            if decision.gesture == "hold":
                self._held[which] = press


def buttons_of(settings: CaptureSection) -> Buttons:
    """The buttons of a configuration."""
    times = GestureTimes(
        int(settings.hold_s * 1e9),
        int(settings.long_s * 1e9),
        int(settings.double_s * 1e9),
    )
    return Buttons(
        {(i.device_id, i.number): i.gesture_actions for i in settings.inputs}, times
    )
