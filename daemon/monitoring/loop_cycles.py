"""The last thousand cycles of the event loop, and a file of them after a fault.

A cycle is one delivery of a device, handled. Kept in memory at next to no cost; written
to a JSON file when something has gone wrong, and at the end, so that afterwards it can
be seen whether the loop was late, interrupted or overrun. docs/reference/service.md
explains the file.
"""

import gc
import json
import statistics
import time
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

from traverse.daemon.clock import HostClock
from traverse.daemon.monitoring.latencies import Latencies
from traverse.drivers.base.values import CountSamples, Delivery

KEPT = 1000
FILES = 10
PATTERN = "cycles-*.json"


class LoopCycle(NamedTuple):
    """One delivery, handled; a tuple, since it is made at every delivery.

    Attributes:
        begun_ns: host monotonic time.
        samples: sets of counts that it brought.
        late_ns: from the reader thread's receipt to the beginning; null where the
            delivery tells no time.
        queue: samples that waited behind it.
        collection_ns: pauses of the garbage collection since the cycle before it.
    """

    device: str
    kind: str
    begun_ns: int
    took_ns: int
    samples: int
    late_ns: int | None
    queue: int
    collection_ns: int


class GarbageCollectionTimer:
    """Times the interpreter's garbage collections; use as a context manager.

    Args:
        latencies: where each pause is noted.
    """

    def __init__(self, latencies: Latencies) -> None:
        self._latencies = latencies
        self._begun_ns = 0
        self.total_ns = 0

    def __enter__(self) -> "GarbageCollectionTimer":
        gc.callbacks.append(self._look)
        return self

    def __exit__(self, *_: object) -> None:
        gc.callbacks.remove(self._look)

    def _look(self, phase: str, _info: dict[str, int]) -> None:
        now_ns = time.monotonic_ns()
        if phase == "start":
            self._begun_ns = now_ns
        elif self._begun_ns:
            self.total_ns += now_ns - self._begun_ns
            self._latencies.add(now_ns - self._begun_ns)
            self._begun_ns = 0


class Cycles:
    """The ring.

    Args:
        clock: the host's.
        collections: that interrupt the cycles.
        handling: where the time that each takes is noted.
    """

    def __init__(
        self, clock: HostClock, collections: GarbageCollectionTimer, handling: Latencies
    ) -> None:
        self._clock = clock
        self._collections = collections
        self._handling = handling
        self._collected_ns = 0
        self._ring: deque[LoopCycle] = deque(maxlen=KEPT)

    def note(self, device: str, delivery: Delivery, begun_ns: int, queue: int) -> None:
        """Note a delivery that has just been handled."""
        took_ns = self._clock.monotonic_ns() - begun_ns
        collected_ns = self._collections.total_ns
        received_ns = getattr(delivery, "received_ns", None)
        self._ring.append(
            LoopCycle(
                device,
                type(delivery).__name__,
                begun_ns,
                took_ns,
                len(delivery.seq) if isinstance(delivery, CountSamples) else 0,
                None if received_ns is None else begun_ns - received_ns,
                queue,
                collected_ns - self._collected_ns,
            )
        )
        self._collected_ns = collected_ns
        self._handling.add(took_ns)

    def taken(self, reason: str) -> "Taken":
        """All that is kept now; takes next to no time."""
        now_ns, offset_ns = self._clock.monotonic_ns(), self._clock.utc_offset_ns()
        return Taken(tuple(self._ring), reason, now_ns + offset_ns, offset_ns)


@dataclass(frozen=True, slots=True)
class Taken:
    """Cycles of a moment, and why they were taken."""

    cycles: tuple[LoopCycle, ...]
    reason: str
    time_ns: int
    utc_offset_ns: int

    def head(self) -> dict[str, Any]:
        """All but the cycles themselves; takes milliseconds."""
        return {
            "schema": "traverse/cycles/1",
            "reason": self.reason,
            "time_ns": str(self.time_ns),
            "utc_offset_ns": str(self.utc_offset_ns),
            "devices": _jitter(self.cycles),
        }

    def lines(self) -> Iterator[str]:
        """The report as JSON, a cycle a line.

        Made line by line: at once it would take two megabytes for a moment, which the
        interpreter never gives back.
        """
        yield json.dumps(self.head(), separators=(",", ":"))[:-1] + ',"cycles":['
        separator = "\n"
        for cycle in self.cycles:
            yield separator + json.dumps(cycle._asdict(), separators=(",", ":"))
            separator = ",\n"
        yield "\n]}\n"


def _jitter(cycles: tuple[LoopCycle, ...]) -> dict[str, dict[str, float]]:
    """How regularly the samples of each device were handled.

    Jitter is the time between the beginnings of two cycles of one device less the
    median of these times.
    """
    begun_ns: dict[str, list[int]] = {}
    for cycle in cycles:
        if cycle.samples:
            begun_ns.setdefault(cycle.device, []).append(cycle.begun_ns)
    found = {}
    for device, times_ns in begun_ns.items():
        if len(times_ns) < 3:
            continue
        intervals_ns = [later - sooner for sooner, later in pairwise(times_ns)]
        median_ns = statistics.median(intervals_ns)
        jitter_us = sorted(abs(one - median_ns) / 1000 for one in intervals_ns)
        found[device] = {
            "interval_us": median_ns / 1000,
            "jitter_p50_us": statistics.median(jitter_us),
            "jitter_max_us": jitter_us[-1],
        }
    return found


def write_report(folder: Path, taken: Taken) -> Path:
    """Write a report beside the latest others; the oldest go. For a thread.

    Raises:
        OSError: it cannot be written.
    """
    moment = time.gmtime(taken.time_ns // 1_000_000_000)
    millis = taken.time_ns // 1_000_000 % 1000
    name = f"cycles-{time.strftime('%Y%m%dT%H%M%S', moment)}.{millis:03d}Z.json"
    path = folder / name
    unfinished = path.with_suffix(".part")
    with unfinished.open("w", encoding="utf-8") as file:
        file.writelines(taken.lines())
    unfinished.replace(path)
    for old in sorted(folder.glob(PATTERN))[:-FILES]:
        old.unlink(missing_ok=True)
    return path
