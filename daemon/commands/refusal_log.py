"""The log of refused commands: some lines in a second, and how many had none."""

import logging

from traverse.daemon.clock import HostClock
from traverse.daemon.commands.rate_limit import LOG_LINES, NS, TokenBucket

log = logging.getLogger("traverse.daemon.commands")


class RefusalLog:
    """Writes so much that senders cannot fill the log at will.

    Args:
        clock: the host's.
    """

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
        """Log how many had no line, a second after the last; call regularly."""
        if self._untold and self._clock.monotonic_ns() - self._last_ns >= NS:
            log.warning("%d more commands refused", self._untold)
            self._untold = 0


def single_line(text: str) -> str:
    """Make a foreign text safe for a log."""
    return "".join(c if c.isprintable() else " " for c in text)[:1000]
