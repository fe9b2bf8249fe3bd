"""Pause between attempts to connect."""

import random
from collections.abc import Callable
from dataclasses import dataclass, field

LASTING_S = 10.0  # a connection that has lasted so long was a good one


@dataclass(eq=False)
class GrowingPause:
    """Pause that doubles until a connection has lasted.

    Args:
        jitter: prevents a fleet from reconnecting all at once.

    Attributes:
        n_short_lived: connections in a row that did not last.
    """

    first_s: float
    last_s: float
    jitter: Callable[[], float] = lambda: random.uniform(0.5, 1.0)
    n_short_lived: int = field(default=0, init=False)

    def __post_init__(self) -> None:
        self._next_s = self.first_s

    def after(self, lasted_s: float | None) -> float:
        """Return the pause [s] after a connection, or after none came about (None)."""
        if lasted_s is not None:
            is_good = lasted_s >= LASTING_S
            self.n_short_lived = 0 if is_good else self.n_short_lived + 1
            if is_good:
                self._next_s = self.first_s
        pause_s = self._next_s
        self._next_s = min(2 * pause_s, self.last_s)
        return pause_s * self.jitter()
