"""Tells whose readings come too late or not at all: once when it begins and ends."""

from collections import Counter
from dataclasses import dataclass

from traverse.daemon.acquisition.resampler import Resampler
from traverse.daemon.clock import HostClock
from traverse.daemon.monitoring.events import EventLog

CALM_NS = 1_000_000_000  # without another one it is over


@dataclass(frozen=True, slots=True)
class _Condition:
    """One thing that can be wrong with a device's readings."""

    code: str
    begun: str
    over: str
    remedy: str


LATE = _Condition(
    "device.late",
    "readings of {device} come too late for the samples of {clock}",
    "readings of {device} come in time again",
    "lower the rate, use a faster line, or raise assembly.wait_s",
)
INCOMPLETE = _Condition(
    "device.incomplete",
    "samples lack readings of {device}",
    "samples have all readings of {device} again",
    "see the other events of this device; check its encoders and their line",
)


class LateReadingMonitor:
    """Follows the counters of an assembly.

    Args:
        assembly: whose counters.
        clock: the host's.
        events: where it is told.
    """

    def __init__(self, assembly: Resampler, clock: HostClock, events: EventLog) -> None:
        self._assembly = assembly
        self._clock = clock
        self._events = events
        self._seen: Counter[tuple[str, str]] = Counter()
        self._last_ns: dict[tuple[str, str], int] = {}

    def look(self) -> None:
        """Look at the counters; call it now and then."""
        now_ns = self._clock.monotonic_ns()
        for condition, counter in (
            (LATE, self._assembly.late),
            (INCOMPLETE, self._assembly.incomplete),
        ):
            for device, count in counter.items():
                key = (condition.code, device)
                if count > self._seen[key]:
                    self._seen[key] = count
                    self._last_ns[key] = now_ns
                    self._tell(condition, device, active=True)
                elif now_ns - self._last_ns.get(key, now_ns) > CALM_NS:
                    del self._last_ns[key]
                    self._tell(condition, device, active=False)

    def _tell(self, condition: _Condition, device: str, *, active: bool) -> None:
        text = condition.begun if active else condition.over
        self._events.change(
            active,
            "warning",
            condition.code,
            text.format(device=device, clock=self._assembly.clock),
            source=device,
            remedy=condition.remedy if active else "",
        )
