"""Events: logged, and published at a limited rate.

The first of its kind is sent at once; repetitions within a second are counted and sent
as one. Of distinct events, such as presses of a button, the first twenty in a second
are sent. A lasting condition is raised and cleared once; a flickering one is sent once
a second with its state and number of changes.
"""

import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Literal

from traverse.daemon.clock import HostClock
from traverse.protocol.printable import printable

log = logging.getLogger("traverse.daemon.events")

QUIET_NS = 1_000_000_000
MAX_DISTINCT = 20  # in a second: more than hands can do, less than a broken button
MAX_CHANGES = (
    6  # of a lasting condition, in `CALM_NS`, before they are reported together
)
CALM_NS = 10_000_000_000
MAX_KINDS = 256
LEVELS = {"info": logging.INFO, "warning": logging.WARNING, "error": logging.ERROR}

Severity = Literal["info", "warning", "error"]


@dataclass(frozen=True, slots=True)
class Occurrence:
    """An event before it is a message; see `traverse.protocol.messages.Event`."""

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


@dataclass(eq=False)
class EventLog:
    """Collects occurrences and passes them on.

    The default source is the first word of the code.

    Args:
        publish: called with occurrences, times monotonic.
        arm: name, for a log with fields.
        changed: called when begin or end of a lasting condition was published.
        begun: called with the data of each that begins, however often it does.
    """

    clock: HostClock
    publish: Callable[[Occurrence], None]
    arm: str = ""
    changed: Callable[[], None] = lambda: None
    begun: Callable[[Mapping[str, int | float | str]], None] = lambda data: None

    def __post_init__(self) -> None:
        self._held: dict[tuple[str, str], Occurrence] = {}
        self._told_ns: dict[tuple[str, str], int] = {}
        self._distinct: dict[tuple[str, str], tuple[int, int]] = {}
        self._active: dict[tuple[str, str], Occurrence] = {}
        self._changed: dict[tuple[str, str], tuple[int, int]] = {}
        self._flapping: dict[tuple[str, str], Occurrence] = {}

    @property
    def active(self) -> tuple[Occurrence, ...]:
        return tuple(self._active.values())

    def report(
        self,
        severity: Severity,
        code: str,
        text: str,
        *,
        source: str = "",
        remedy: str = "",
        count: int = 1,
        data: Mapping[str, int | float | str] | None = None,
        distinct: bool = False,
    ) -> None:
        """Report ``count`` momentary occurrences.

        With ``distinct`` each is sent by itself, up to a limit.
        """
        text, remedy = printable(text), printable(remedy)
        now_ns = first_ns = self.clock.monotonic_ns()
        source = source or code.partition(".")[0]
        key = (code, source)
        if distinct:
            is_told = self._is_one_of_few(
                self._distinct, key, now_ns, MAX_DISTINCT, QUIET_NS
            )
            if is_told and (held := self._held.pop(key, None)) is not None:
                self._tell(key, held)
        else:
            is_told = now_ns - self._told_ns.get(key, now_ns - QUIET_NS) >= QUIET_NS
        if not is_told and (held := self._held.get(key)) is not None:
            first_ns, count = held.first_ns, held.count + count
        occurrence = Occurrence(
            *(severity, code, text, remedy, source, None),
            *(first_ns, now_ns, count, data or {}),
        )
        if is_told:
            self._tell(key, occurrence)
        else:
            self._held[key] = occurrence

    def change(
        self,
        active: bool,
        severity: Severity,
        code: str,
        text: str,
        *,
        source: str = "",
        remedy: str = "",
        data: Mapping[str, int | float | str] | None = None,
    ) -> None:
        """Begin or end a lasting condition, reported once each.

        With too many conditions it is reported as momentary.
        """
        source = source or code.partition(".")[0]
        key = (code, source)
        if active == (key in self._active):
            return
        if active and data:
            self.begun(data)
        if active and len(self._active) >= MAX_KINDS:
            self.report(severity, code, text, source=source, remedy=remedy, data=data)
            return
        now_ns = self.clock.monotonic_ns()
        level: Severity = severity if active else "info"
        change = Occurrence(
            *(level, code, printable(text), printable(remedy), source, active),
            *(now_ns, now_ns, 1, data or {}),
        )
        if active:
            self._active[key] = change
        else:
            del self._active[key]
        if (held := self._flapping.get(key)) is not None:
            self._flapping[key] = replace(
                change, first_ns=held.first_ns, count=held.count + 1
            )
        elif self._is_one_of_few(self._changed, key, now_ns, MAX_CHANGES, CALM_NS):
            self._tell(key, change)
        else:
            self._flapping[key] = change

    def flush(self, *, at_once: bool = False) -> None:
        """Report occurrences held back for up to a second; call often."""
        now_ns = self.clock.monotonic_ns()
        for waiting in (self._held, self._flapping):
            for key, held in list(waiting.items()):
                if at_once or now_ns - self._told_ns.get(key, 0) >= QUIET_NS:
                    del waiting[key]
                    self._tell(key, held)

    def _is_one_of_few(
        self,
        seen: dict[tuple[str, str], tuple[int, int]],
        key: tuple[str, str],
        now_ns: int,
        most: int,
        period_ns: int,
    ) -> bool:
        """Count in ``seen``; return whether at most ``most`` came in the period."""
        since_ns, n = seen.get(key, (now_ns, 0))
        if now_ns - since_ns >= period_ns:
            since_ns, n = now_ns, 0
        if len(seen) >= MAX_KINDS:
            seen.clear()
        seen[key] = since_ns, n + 1
        return n < most

    def _tell(self, key: tuple[str, str], occurrence: Occurrence) -> None:
        if len(self._told_ns) >= MAX_KINDS:
            self._told_ns.clear()
        self._told_ns[key] = occurrence.last_ns
        times = f" ({occurrence.count} times)" if occurrence.count > 1 else ""
        remedy = f"; {occurrence.remedy}" if occurrence.remedy else ""
        fields = {
            "arm": self.arm,
            "device": occurrence.source.partition("/")[0],
            "source": occurrence.source,
            "code": occurrence.code,
            "count": occurrence.count,
            "remedy": occurrence.remedy,
        }
        log.log(
            LEVELS[occurrence.severity],
            "%s: %s%s%s",
            occurrence.code,
            occurrence.text,
            times,
            remedy,
            extra={"fields": fields},
        )
        self.publish(occurrence)
        if occurrence.active is not None:
            self.changed()
