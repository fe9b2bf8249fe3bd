"""Watch over the computer's UTC for the service."""

from collections.abc import Callable
from pathlib import Path

from traverse.daemon.clock import HostClock
from traverse.daemon.utc import REMEDY, UtcFile, UtcJudge

LOOK_NS = 1_000_000_000


class UtcWatch:
    """Judges the present time repeatedly.

    Args:
        path: of the memory's file.
        judged: called with reason and remedy when the doubt changes; both are empty
            for none.
    """

    def __init__(
        self, clock: HostClock, path: Path, judged: Callable[[str, str], None]
    ) -> None:
        self._clock = clock
        self._file = UtcFile(path)
        self._judge = UtcJudge(self._file.memory)
        self._judged = judged
        self._is_doubted: bool | None = None
        self._looked_ns = -LOOK_NS

    def check(self) -> None:
        """Judge the time; call often."""
        now_ns = self._clock.monotonic_ns()
        if now_ns - self._looked_ns < LOOK_NS:
            return
        self._looked_ns = now_ns
        utc_ns = self._clock.to_utc_ns(now_ns)
        self._judge.note_elapsed(utc_ns, self._clock.elapsed_ns())
        doubt = self._judge.doubt(utc_ns)
        if bool(doubt) != self._is_doubted:
            self._is_doubted = bool(doubt)
            self._judged(doubt, REMEDY if doubt else "")
        self._file.keep()

    def confirm(self) -> None:
        """Accept the computer's UTC on the operator's word."""
        self._judge.confirm(self._clock.to_utc_ns(self._clock.monotonic_ns()))
        self._looked_ns = -LOOK_NS
        self.check()

    def confirm_unverified(self) -> str:
        """Who confirms the arm confirms a possible time with it; what, in words.

        Empty where the time is not in doubt, or cannot be.
        """
        now_ns = self._clock.monotonic_ns()
        text = self._judge.unverified(self._clock.to_utc_ns(now_ns))
        if text:
            self.confirm()
        return text

    def close(self) -> None:
        """Wait until all is on the disk."""
        self._file.close()
