"""Rate limits of commands, in all and by kind.

MQTT does not identify senders; the limits hold for all together. Logging of refusals is
limited likewise.
"""

import logging
from collections.abc import Callable, Mapping
from typing import Final, NamedTuple

from traverse.daemon.clock import HostClock
from traverse.protocol.printable import printable

log = logging.getLogger("traverse.daemon.commands")

NS: Final = 1_000_000_000


class Limit(NamedTuple):
    """Permissions per second in the long run, and at once after a rest."""

    rate_hz: float
    at_once: int


ALL: Final = Limit(100.0, 200)
OTHERS: Final = Limit(10.0, 20)
OF_KIND: Final[Mapping[str, Limit]] = {
    "point": Limit(50.0, 100),
    "resend": Limit(5.0, 20),
    "session": Limit(2.0, 10),
    "reload": Limit(1.0, 5),
}
OURS: Final = Limit(20.0, 100)
"""Messages on a topic that the daemon itself writes to: its status, its clock."""
LOG_LINES: Final = Limit(5.0, 20)
FLOOD: Final = 200
"""Commands dropped in a second before the broker is asked to keep them."""
PAUSE_S: Final = 2.0
"""How long the broker then keeps commands."""
FLOOD_END_S: Final = 5.0
"""Time without a dropped command that ends a flood; longer than a pause."""


class TokenBucket:
    """Grants permissions at a rate, some of them saved up."""

    def __init__(self, limit: Limit, clock: HostClock) -> None:
        self._limit = limit
        self._clock = clock
        self._saved = float(limit.at_once)
        self._last_ns = clock.monotonic_ns()

    def take(self) -> bool:
        now_ns = self._clock.monotonic_ns()
        earned = (now_ns - self._last_ns) / NS * self._limit.rate_hz
        self._saved = min(float(self._limit.at_once), self._saved + earned)
        self._last_ns = now_ns
        if self._saved < 1.0:
            return False
        self._saved -= 1.0
        return True


class CommandRateLimiter:
    """Token buckets of all commands, and counters of refusals.

    Args:
        tell: called with True when commands begin to be dropped, and with False and
            their number at the end.
        kinds: names of all commands; unknown ones share a bucket.
    """

    def __init__(
        self,
        clock: HostClock,
        tell: Callable[[bool, int], None],
        kinds: Mapping[str, object],
    ) -> None:
        self._clock = clock
        self._tell = tell
        self._all = TokenBucket(ALL, clock)
        self._of_kind = {
            name: TokenBucket(OF_KIND.get(name, OTHERS), clock) for name in kinds
        }
        self._unknown = TokenBucket(OTHERS, clock)
        self._last_ns: int | None = None
        self._second_ns = clock.monotonic_ns()
        self._in_second = 0
        self.dropped = 0
        """In the current flood, or the last one."""

    def admit(self) -> bool:
        if self._all.take():
            return True
        if self._last_ns is None:
            self.dropped = 0
            self._tell(True, 1)
        self._last_ns = now_ns = self._clock.monotonic_ns()
        self.dropped += 1
        if now_ns - self._second_ns >= NS:
            self._second_ns, self._in_second = now_ns, 0
        self._in_second += 1
        return False

    def admit_kind(self, name: str) -> bool:
        return self._of_kind.get(name, self._unknown).take()

    @property
    def is_flooded(self) -> bool:
        """Whether so many are dropped that the broker should keep them."""
        return self._in_second >= FLOOD

    def check_flood_end(self) -> None:
        """Report the end of a flood; call regularly."""
        if self._last_ns is None:
            return
        if self._clock.monotonic_ns() - self._last_ns >= FLOOD_END_S * NS:
            self._last_ns = None
            self._in_second = 0
            self._tell(False, self.dropped)


class RefusalLog:
    """Logs refusals at a limited rate."""

    def __init__(self, clock: HostClock) -> None:
        self._clock = clock
        self._lines = TokenBucket(LOG_LINES, clock)
        self._untold = 0
        self._last_ns = 0

    def write(self, text: str) -> None:
        """Log a refused command, or count it for the next line."""
        self._last_ns = self._clock.monotonic_ns()
        if not self._lines.take():
            self._untold += 1
            return
        before = f" ({self._untold} more refused before it)" if self._untold else ""
        self._untold = 0
        log.warning("%s%s", single_line(text), before)

    def write_rest(self) -> None:
        """Log the count of unlogged ones a second after the last; call regularly."""
        if self._untold and self._clock.monotonic_ns() - self._last_ns >= NS:
            log.warning("%d more commands refused", self._untold)
            self._untold = 0


def single_line(text: str) -> str:
    return printable(text[:1000])[:1000]
