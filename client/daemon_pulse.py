"""Whether anything arrives from a daemon, by the clock that it sends twice a second.

A daemon that is stopped keeps its connection: its last status says for long that all is
well. Its clock does not come any more.
"""

import asyncio
from collections.abc import Callable

from traverse.protocol.messages import Status

TURN_S = 0.25
SILENT_S = 1.5
SILENT = "nothing arrives from its daemon, which may be stopped"


class DaemonPulse:
    """Counts turns of the event loop without a message of the clock.

    A program that blocks its loop, or a computer that slept, finds the messages that
    came meanwhile before the next turns are counted: that is no silence of the daemon.

    Args:
        changed: called when a silence begins or ends.
    """

    def __init__(self, changed: Callable[[], None] = lambda: None) -> None:
        self._changed = changed
        # Without a clock in this connection nothing is expected: an account may not
        # be allowed to read it.
        self._turns: int | None = None
        self._was_silent = False

    @property
    def is_silent(self) -> bool:
        return self._turns is not None and self._turns * TURN_S > SILENT_S

    def beat(self) -> None:
        """Take a message of the clock."""
        self._turns = 0
        self._look()

    def reset(self) -> None:
        """Expect nothing: the connection is lost."""
        self._turns = None
        self._look()

    async def run(self) -> None:
        while True:
            await asyncio.sleep(TURN_S)
            if self._turns is not None:
                self._turns += 1
                self._look()

    def _look(self) -> None:
        if self.is_silent != self._was_silent:
            self._was_silent = self.is_silent
            self._changed()


def as_offline(status: Status) -> Status:
    """Return the last status of a daemon from which nothing arrives any more."""
    unknown = {"alarms": (), "conditions": ()}
    return status.model_copy(update={"online": False, "state": "offline", **unknown})
