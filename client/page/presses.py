"""Presses of buttons and keys: executed within two seconds, or reported lost.

Strategy: before each click or key the browser states its time by the server's clock,
known from beats (`watch.js`). A server that was suspended could not tell old clicks in
its socket from new ones otherwise. The browser gets an answer to each press; without
one it reports the press as lost, and after a second without a beat it marks the page as
out of date.
"""

import time
from collections.abc import Awaitable, Callable
from functools import wraps
from math import inf
from typing import ParamSpec

from nicegui import ui
from nicegui.events import GenericEventArguments

P = ParamSpec("P")
Handler = Callable[P, Awaitable[None] | None]

BEAT_S = 0.25
VALID_S = 2.0


class Presses:
    """Presses of one browser; created while its page is built."""

    def __init__(self) -> None:
        self._client = ui.context.client
        self._is_valid = True
        ui.on("traverse_press", self._take)
        ui.timer(BEAT_S, self._beat)

    def guard(self, act: Handler[P]) -> Handler[P]:
        """Wrap an action, which does nothing if its press came too late.

        This is judged in the call itself, since a coroutine could see a later press.
        """

        @wraps(act)  # NiceGUI looks whether it takes the event
        def guarded(*args: P.args, **kwargs: P.kwargs) -> Awaitable[None] | None:
            return act(*args, **kwargs) if self._is_valid else None

        return guarded

    def _beat(self) -> None:
        self._client.run_javascript(f"traverse_watch.beat({_now_ms()})")

    def _take(self, event: GenericEventArguments) -> None:
        number, at_ms = event.args["id"], event.args["at_ms"]
        # Infinity: the browser had no beat yet, so nobody knows.
        late_s = inf if at_ms is None else (_now_ms() - float(at_ms)) * 1e-3
        self._is_valid = late_s <= VALID_S
        late = "null" if self._is_valid else "Infinity" if late_s == inf else late_s
        self._client.run_javascript(f"traverse_watch.answered({int(number)}, {late})")


def _now_ms() -> float:
    """Return a clock that includes suspension of the computer."""
    return time.clock_gettime_ns(time.CLOCK_BOOTTIME) * 1e-6
