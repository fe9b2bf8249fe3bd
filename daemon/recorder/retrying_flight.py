"""The flight recorder, left alone for some time after the disk has refused it."""

import time
from collections.abc import Callable
from pathlib import Path

from traverse.daemon.recorder.flight import FlightRecorder
from traverse.daemon.recorder.notification import Told, reason_of

RETRY_S = 30.0


class RetryingFlightRecorder:
    """Used by the thread of recordings alone.

    Args:
        flight: what writes.
        is_enabled: the configuration wants it to.
        tell: told when it fails, and when it is tried again.
    """

    def __init__(
        self, flight: FlightRecorder, *, is_enabled: bool, tell: Callable[[Told], None]
    ) -> None:
        self._flight = flight
        self._is_wanted = is_enabled
        self._tell = tell
        self._retry_s: float | None = None

    def do(self, act: Callable[[], object]) -> None:
        """Do something with it, unless it is left alone."""
        if not self._is_wanted or self._retry_s is not None:
            return
        try:
            act()
        except OSError as error:
            self._flight.abandon()
            self._retry_s = time.monotonic() + RETRY_S
            self._tell(Told(flight_failed=reason_of(error)))

    def keep(self, why: str) -> None:
        """Keep the last minutes, after a fault."""
        self.do(lambda: self._tell_kept(self._flight.keep(why)))

    def recover_crashed(self) -> None:
        """Keep what a daemon left behind that died."""
        self.do(lambda: self._tell_kept(self._flight.recover_crashed()))

    def retry(self, now_s: float) -> None:
        """Use it once more, if it is time; the next state begins a segment."""
        if self._retry_s is not None and now_s >= self._retry_s:
            self._retry_s = None
            self._tell(Told(flight_failed=""))

    def _tell_kept(self, kept: Path | None) -> None:
        if kept is not None:
            self._tell(Told(kept=kept))
