"""Judgement of the computer's UTC.

A computer without a clock battery starts in 1970, one with a wrong one years ahead; NTP
sets it right later, or never. The kernel knows whether a program keeps the clock
synchronised; in a laboratory without a network nothing does, and only the operator can
say whether the clock is right. Once said, it is believed from then on, over restarts,
as long as the time is possible: not before this version was made, not years after it,
and neither before the latest time that was believed here nor much later.
"""

import ctypes
import json
import logging
import os
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

from traverse.strict_toml.files import json_of
from traverse.strict_toml.problems import reason_of
from traverse.strict_toml.writing import write_atomically

log = logging.getLogger("traverse.daemon.service")

MADE = datetime(2026, 11, 1, tzinfo=UTC)
"""No measurement with this version is older."""
YEARS_IN_USE = 5
DAY_NS = 86_400 * 10**9
MADE_NS = int(MADE.timestamp()) * 10**9
LATEST_NS = MADE_NS + YEARS_IN_USE * 366 * DAY_NS
MAX_BACK_NS = 60 * 10**9  # a clock that nothing keeps is set by hand now and then
MAX_AWAY_NS = 400 * DAY_NS  # switched off for longer
MAX_ERROR_US = 1_000_000  # of a synchronised clock
REMEMBER_NS = 600 * 10**9
REMEDY = (
    "set the computer's clock and let it be synchronised (chrony, systemd-timesyncd); "
    "where it is right, confirm it: `traverse confirm --utc`"
)
_STA_UNSYNC = 0x40


class _Timex(ctypes.Structure):
    """Beginning of `struct timex` of adjtimex(2), with room for its rest."""

    _fields_ = (
        ("modes", ctypes.c_uint),
        ("offset", ctypes.c_long),
        ("frequency", ctypes.c_long),
        ("max_error_us", ctypes.c_long),
        ("estimated_error_us", ctypes.c_long),
        ("status", ctypes.c_int),
        ("rest", ctypes.c_byte * 512),
    )


def is_synchronised() -> bool:
    """Return whether the kernel's clock is synchronised; False also if unknown."""
    try:
        adjtimex = ctypes.CDLL(None, use_errno=True).adjtimex
    except (OSError, AttributeError):
        return False
    timex = _Timex()
    if adjtimex(ctypes.byref(timex)) < 0:
        return False
    return not timex.status & _STA_UNSYNC and timex.max_error_us < MAX_ERROR_US


def as_text(utc_ns: int) -> str:
    """Format UTC to the minute; a computer may show any."""
    try:
        return f"{datetime.fromtimestamp(utc_ns * 1e-9, UTC):%Y-%m-%d %H:%M} UTC"
    except (ValueError, OverflowError, OSError):
        return f"{utc_ns * 1e-9:.0f} s after 1970"


@dataclass
class UtcMemory:
    """State that outlives the daemon.

    Attributes:
        good_ns: latest trusted time; 0 for none.
        confirmed_ns: latest time that the operator confirmed.
        set_by_ns: by how much a trusted time was set while nothing kept it; 0 for not.
    """

    good_ns: int = 0
    confirmed_ns: int = 0
    set_by_ns: int = 0


class UtcJudge:
    """Judges the computer's UTC.

    Args:
        synchronised: whether the kernel's clock is.
    """

    def __init__(
        self,
        memory: UtcMemory,
        synchronised: Callable[[], bool] = is_synchronised,
    ) -> None:
        self.memory = memory
        self._synchronised = synchronised
        self._trusted: tuple[int, int] | None = None  # the last UTC, and elapsed time

    def note_elapsed(self, utc_ns: int, elapsed_ns: int) -> None:
        """Note a present time beside one that runs on whatever UTC is set to.

        Whether it was right before a clock was set by hand, or is now, nobody knows.
        """
        if self._trusted is not None:
            set_by_ns = utc_ns - self._trusted[0] - (elapsed_ns - self._trusted[1])
            if abs(set_by_ns) > MAX_BACK_NS:
                self.memory.set_by_ns += set_by_ns
        is_trusted = self.memory.set_by_ns or not self.doubt(utc_ns)
        self._trusted = (utc_ns, elapsed_ns) if is_trusted else None

    def unverified(self, utc_ns: int) -> str:
        """A possible time of which nothing has shown yet that it is right, in words.

        Empty for all others: what confirms the arm is no word for an impossible time.
        """
        if self.memory.good_ns or self._impossible(utc_ns) or self._synchronised():
            return ""
        return f"the computer's clock shows {as_text(utc_ns)}"

    def doubt(self, utc_ns: int) -> str:
        """State why a present time is in doubt; empty if not, and remembered."""
        text = self._doubt(utc_ns)
        if not text:
            self.memory.good_ns = utc_ns
        return text

    def confirm(self, utc_ns: int) -> None:
        """Accept a present time on the operator's word."""
        self.memory.good_ns = self.memory.confirmed_ns = utc_ns
        self.memory.set_by_ns = 0

    def _doubt(self, utc_ns: int) -> str:
        good_ns = self.memory.good_ns
        now = f"the computer's clock shows {as_text(utc_ns)}"
        if impossible := self._impossible(utc_ns):
            return f"{now}, {impossible}"
        if self._synchronised():
            self.memory.set_by_ns = 0
            return ""
        if not good_ns:
            return (
                f"{now}; no program keeps it synchronised, and nobody has confirmed it"
            )
        if utc_ns < good_ns - MAX_BACK_NS:
            return f"{now}, and has shown {as_text(good_ns)} before"
        if utc_ns > good_ns + MAX_AWAY_NS:
            return (
                f"{now}, {(utc_ns - good_ns) / DAY_NS:.0f} days after it was last right"
            )
        set_by_s = self.memory.set_by_ns * 1e-9
        is_set = abs(self.memory.set_by_ns) > MAX_BACK_NS
        text = f"{now}; it was set by {set_by_s:+.0f} s, and no program keeps it"
        return f"{text} synchronised" if is_set else ""

    def _impossible(self, utc_ns: int) -> str:
        """Why a time cannot be, unless it was confirmed."""
        confirmed_ns = self.memory.confirmed_ns
        if confirmed_ns and -MAX_BACK_NS <= utc_ns - confirmed_ns <= MAX_AWAY_NS:
            return ""
        if utc_ns < MADE_NS:
            return f"before this version was made ({as_text(MADE_NS)})"
        if utc_ns > LATEST_NS:
            return f"more than {YEARS_IN_USE} years after this version was made"
        return ""


class UtcFile:
    """The memory of one arm's daemon on the disk, written by a thread of its own."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._thread = ThreadPoolExecutor(1, "utc")
        self._written = UtcMemory()
        self.memory = UtcMemory()
        try:
            stored = json_of(path)
            if isinstance(stored, dict):
                names = ("good_ns", "confirmed_ns", "set_by_ns")
                self.memory = UtcMemory(*(int(stored.get(name, 0)) for name in names))
        except FileNotFoundError:
            pass
        except (OSError, ValueError, TypeError) as error:
            log.warning(
                "%s cannot be read, and is begun anew: %s", path, reason_of(error)
            )

    def keep(self) -> None:
        """Write the memory if it is newer by some minutes."""
        memory, written = self.memory, self._written
        if abs(memory.good_ns - written.good_ns) < REMEMBER_NS and (
            (memory.confirmed_ns, memory.set_by_ns)
            == (written.confirmed_ns, written.set_by_ns)
        ):
            return
        self._written = replace(memory)
        text = json.dumps(vars(self._written), indent=1)
        self._thread.submit(self._write, text).add_done_callback(self._report)

    def close(self) -> None:
        self._thread.shutdown()

    def _write(self, text: str) -> None:
        if os.path.isdir(self._path.parent):  # else there is no state yet to go with it
            write_atomically(self._path, text)

    def _report(self, done: "Future[None]") -> None:
        if (error := done.exception()) is not None:
            log.warning("%s cannot be written: %s", self._path, reason_of(error))
