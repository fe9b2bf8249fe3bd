"""Events: logged, and published without flooding.

The first of its kind goes out at once; what repeats within a second is counted and
told once. Of those that are distinct, such as presses of a button, it is the first
twenty in a second. A lasting condition is raised once and cleared once.
"""

import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Literal

from daemon.clock import HostClock

log = logging.getLogger("daemon.events")

QUIET_NS = 1_000_000_000
MAX_DISTINCT = 20  # in a second: more than hands can do, less than a broken button
MAX_KINDS = 256
LEVELS = {"info": logging.INFO, "warning": logging.WARNING, "error": logging.ERROR}

Severity = Literal["info", "warning", "error"]


@dataclass(frozen=True, slots=True)
class Occurrence:
    """What happened, before it is a message; see `protocol.messages.Event`."""

    severity: Severity
    code: str
    text: str
    remedy: str
    source: str
    active: bool | None
    first_ns: int
    last_ns: int
    count: int
    data: Mapping[str, int | float | str]


class EventLog:
    """Collects occurrences and passes them on.

    Args:
        clock: the host's.
        publish: called with what is to be published, times monotonic.
    """

    def __init__(self, clock: HostClock, publish: Callable[[Occurrence], None]) -> None:
        self._clock = clock
        self._publish = publish
        self._held: dict[tuple[str, str], Occurrence] = {}
        self._told_ns: dict[tuple[str, str], int] = {}
        self._distinct: dict[tuple[str, str], tuple[int, int]] = {}
        self._active: set[tuple[str, str]] = set()

    def report(
        self,
        severity: Severity,
        code: str,
        text: str,
        *,
        source: str,
        remedy: str = "",
        count: int = 1,
        data: Mapping[str, int | float | str] | None = None,
        distinct: bool = False,
    ) -> None:
        """Something momentary happened ``count`` times.

        With ``distinct`` every one is told by itself, as for buttons, unless there are
        too many; the other arguments are those of the message.
        """
        now_ns = self._clock.monotonic_ns()
        occurrence = Occurrence(
            severity,
            code,
            text,
            remedy,
            source,
            None,
            now_ns,
            now_ns,
            count,
            data or {},
        )
        key = (code, source)
        if distinct:
            is_told = self._is_one_of_few(key, now_ns)
        else:
            is_told = now_ns - self._told_ns.get(key, now_ns - QUIET_NS) >= QUIET_NS
        if is_told:
            self._tell(key, occurrence)
        elif (held := self._held.get(key)) is not None:
            self._held[key] = replace(
                occurrence, first_ns=held.first_ns, count=held.count + count
            )
        else:
            self._held[key] = occurrence

    def change(
        self,
        active: bool,
        severity: Severity,
        code: str,
        text: str,
        *,
        source: str,
        remedy: str = "",
        data: Mapping[str, int | float | str] | None = None,
    ) -> None:
        """A lasting condition begins or ends; told once each way.

        With more conditions than anybody can read it is told as a momentary one.
        """
        key = (code, source)
        if active == (key in self._active):
            return
        if active and len(self._active) >= MAX_KINDS:
            self.report(severity, code, text, source=source, remedy=remedy, data=data)
            return
        (self._active.add if active else self._active.discard)(key)
        now_ns = self._clock.monotonic_ns()
        level: Severity = severity if active else "info"
        self._tell(
            key,
            Occurrence(
                level, code, text, remedy, source, active, now_ns, now_ns, 1, data or {}
            ),
        )

    def flush(self) -> None:
        """Tell what was held back for a second; call it a few times a second."""
        now_ns = self._clock.monotonic_ns()
        for key, held in list(self._held.items()):
            if now_ns - self._told_ns.get(key, 0) >= QUIET_NS:
                del self._held[key]
                self._tell(key, held)

    def _is_one_of_few(self, key: tuple[str, str], now_ns: int) -> bool:
        """Whether a distinct one is told; what was held back before is told first."""
        since_ns, n = self._distinct.get(key, (now_ns, 0))
        if now_ns - since_ns >= QUIET_NS:
            since_ns, n = now_ns, 0
            if (held := self._held.pop(key, None)) is not None:
                self._tell(key, held)
        if len(self._distinct) >= MAX_KINDS:
            self._distinct.clear()
        self._distinct[key] = since_ns, n + 1
        return n < MAX_DISTINCT

    def _tell(self, key: tuple[str, str], occurrence: Occurrence) -> None:
        if len(self._told_ns) >= MAX_KINDS:
            self._told_ns.clear()
        self._told_ns[key] = occurrence.last_ns
        times = f" ({occurrence.count} times)" if occurrence.count > 1 else ""
        remedy = f"; {occurrence.remedy}" if occurrence.remedy else ""
        log.log(
            LEVELS[occurrence.severity],
            "%s: %s%s%s",
            occurrence.code,
            occurrence.text,
            times,
            remedy,
        )
        self._publish(occurrence)
