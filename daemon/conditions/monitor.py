"""Monitor of the conditions: which are established, and events for the others."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import astuple, dataclass, replace
from typing import Any

from traverse.daemon.clock import HostClock
from traverse.daemon.conditions.table import ARM, BY_NAME, CONDITIONS, Condition
from traverse.daemon.monitoring.events import EventLog
from traverse.protocol.messages.quality import FLAG_MEANINGS

CALM_NS = 1_000_000_000  # without a marked sample so long it is established again
PATIENCE_NS = 5_000_000_000  # to be established at first before an event says it is not
NOT_YET = "not established yet"

Key = tuple[str, str]
"""Condition and subject."""


@dataclass(frozen=True, slots=True)
class Standing:
    """State of one condition of one subject.

    Attributes:
        subject: id of the device; `ARM` or `HOST`.
        since_ns: host monotonic time of the last change.
        cause: why it is not established; else empty.
        remedy: what to do about it; may be empty.
        is_reported: its lasting event has begun.
    """

    name: str
    subject: str
    established: bool
    since_ns: int
    cause: str
    remedy: str
    is_reported: bool = False

    @property
    def condition(self) -> Condition:
        return BY_NAME[self.name]


class ConditionMonitor:
    """State of every condition that applies; each begins in doubt.

    Calls on conditions that do not apply are ignored.

    Attributes:
        changed: called when a state has changed.
        bits: flags of every number now.
    """

    def __init__(self, clock: HostClock, events: EventLog) -> None:
        self._clock = clock
        self._events = events
        self._standings: dict[Key, Standing] = {}
        self._counting: frozenset[str] = frozenset()
        self._sample_rows: list[tuple[str, int]] = []
        self._sample_bits = 0
        self._marked_ns: dict[Key, int] = {}
        self._marked_bits: dict[str, int] = {}
        self._open: frozenset[Key] = frozenset()
        self.changed: Callable[[], None] = lambda: None
        self.bits = 0

    # -- what applies ---------------------------------------------------------

    def use(
        self, subjects: Mapping[str, Iterable[str]], counting: Sequence[str]
    ) -> None:
        """Set the subjects of each condition; new ones begin in doubt.

        Of devices only those in ``counting`` mark numbers, which read joints.
        """
        now_ns = self._clock.monotonic_ns()
        keys = {
            (row.name, subject): row
            for row in CONDITIONS
            for subject in subjects.get(row.name, ())
        }
        for key in self._standings.keys() - keys.keys():
            self._end_event(self._standings.pop(key), "it does not apply any more")
            self._marked_ns.pop(key, None)
        self._standings = {
            key: self._standings.get(key)
            or Standing(*key, False, now_ns, NOT_YET, row.remedy)
            for key, row in keys.items()
        }
        self._counting = frozenset(counting)
        self._sample_rows = [
            (row.name, int(row.flags))
            for row in CONDITIONS
            if row.marks == "samples"
            and row.subject == "arm"  # a device may have this name, too
            and (row.name, ARM) in self._standings
        ]
        self._sample_bits = 0
        for _, bits in self._sample_rows:
            self._sample_bits |= bits
        self._update_bits()

    # -- what holds -----------------------------------------------------------

    def is_established(self, name: str, subject: str = ARM) -> bool:
        """Return whether it is established or does not apply."""
        standing = self._standings.get((name, subject))
        return standing is None or standing.established

    @property
    def all_established(self) -> bool:
        return not any(
            not standing.established and self._counts(standing)
            for standing in self._standings.values()
        )

    def _counts(self, standing: Standing) -> bool:
        is_of_device = standing.condition.subject == "device"
        return not is_of_device or standing.subject in self._counting

    @property
    def standings(self) -> tuple[Standing, ...]:
        return tuple(self._standings.values())

    def establish(self, name: str, subject: str = ARM, text: str = "") -> None:
        """Establish a condition; ``text`` goes into the event that ends."""
        before = self._standings.get((name, subject))
        if before is None or before.established:
            return
        self._marked_ns.pop((name, subject), None)
        now_ns = self._clock.monotonic_ns()
        self._standings[name, subject] = Standing(name, subject, True, now_ns, "", "")
        self._end_event(before, text or before.condition.means)
        self._update_bits()
        self.changed()

    def doubt(
        self,
        name: str,
        subject: str = ARM,
        cause: str = NOT_YET,
        data: Mapping[str, int | float | str] | None = None,
        *,
        remedy: str = "",
    ) -> None:
        before = self._standings.get((name, subject))
        if before is None or (before.cause == cause and before.is_reported):
            return
        row = before.condition
        since_ns = self._clock.monotonic_ns() if before.established else before.since_ns
        self._end_event(before, "more is in doubt")
        after = Standing(name, subject, False, since_ns, cause, remedy or row.remedy)
        self._standings[name, subject] = self._reported(after, data)
        self._update_bits()
        self.changed()

    def add_samples(self, flags: int) -> None:
        if not flags & self._sample_bits and not self._open:
            return
        for name, bits in self._sample_rows:
            if marked := flags & bits:
                # All that it was flagged with since it held: no event for each change.
                if (name, ARM) in self._open:
                    marked |= self._marked_bits.get(name, 0)
                self._marked_bits[name] = marked
                self.mark(name, ARM, meanings(marked))
            elif (name, ARM) in self._open:
                self.settle(name, ARM)

    def mark(self, name: str, subject: str, cause: str) -> None:
        """Note that a sample is flagged by a condition of samples."""
        key = name, subject
        before = self._standings.get(key)
        if before is None:
            return
        self._marked_ns[key] = self._clock.monotonic_ns()
        if before.established or before.is_reported:
            self.doubt(name, subject, cause)
        elif before.cause != cause:  # since its begin: reported if it stays
            self._standings[key] = replace(before, cause=cause)

    def settle(self, name: str, subject: str, text: str = "") -> None:
        """Note an unflagged sample; after a while without flags the condition holds.

        ``text`` goes into the event that ends.
        """
        key = name, subject
        if key not in self._open:
            return
        now_ns = self._clock.monotonic_ns()
        if now_ns - self._marked_ns.get(key, now_ns - CALM_NS) >= CALM_NS:
            self.establish(name, subject, text)

    def check_overdue(self) -> None:
        """Report conditions that were long not established; call regularly.

        For an absent device only its absence is reported.
        """
        now_ns = self._clock.monotonic_ns()
        if any(
            not standing.established
            for standing in self._standings.values()
            if standing.name == "present" and self._counts(standing)
        ):
            return
        for key, standing in self._standings.items():
            if standing.established or standing.is_reported:
                continue
            if now_ns - standing.since_ns >= PATIENCE_NS:
                self._standings[key] = self._reported(standing, None)

    # -- over a snapshot ------------------------------------------------------

    @property
    def state(self) -> list[list[object]]:
        return [list(astuple(s)) for s in self._standings.values()]

    def resume(self, state: Sequence[Sequence[Any]]) -> None:
        for values in state:
            standing = Standing(*values)
            key = standing.name, standing.subject
            if key in self._standings:
                self._standings[key] = standing
        self._update_bits()

    # -- events and bits ------------------------------------------------------

    def _reported(
        self, standing: Standing, data: Mapping[str, int | float | str] | None
    ) -> Standing:
        row = standing.condition
        self._events.change(
            True,
            row.severity,
            row.code,
            standing.cause,
            source=standing.subject,
            remedy=standing.remedy,
            data=data,
        )
        return replace(standing, is_reported=True)

    def _end_event(self, standing: Standing, text: str) -> None:
        if standing.is_reported:
            row = standing.condition
            self._events.change(
                False, row.severity, row.code, text, source=standing.subject
            )

    def _update_bits(self) -> None:
        """Compute `bits` on a change, so that blocks only read them."""
        in_doubt = [s for s in self._standings.values() if not s.established]
        self._open = frozenset((s.name, s.subject) for s in in_doubt)
        self.bits = 0
        for standing in in_doubt:
            row = standing.condition
            if row.marks == "all" and self._counts(standing):
                self.bits |= int(row.flags)


def meanings(flags: int) -> str:
    return "; ".join(text for flag, text in FLAG_MEANINGS.items() if flag & flags)
