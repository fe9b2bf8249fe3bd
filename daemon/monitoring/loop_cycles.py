"""The last thousand cycles of the event loop, and a report of them after a fault.

A cycle is one delivery of a device, handled. Kept in memory at next to no cost; written
to a JSON file after a fault, and at the end, so that afterwards it can
be seen whether the loop was late, interrupted or overrun. docs/reference/service.md
explains the file.
"""

import asyncio
import gc
import json
import logging
import statistics
import time
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

from traverse.daemon.clock import HostClock
from traverse.daemon.monitoring.events import Occurrence
from traverse.daemon.monitoring.latencies import Latencies
from traverse.drivers.base.values import CountSamples, Delivery

log = logging.getLogger(__name__)

KEPT = 1000
FILES = 10
PATTERN = "cycles-*.json"
REPORT_NS = 60_000_000_000  # between two reports, however many faults


class LoopCycle(NamedTuple):
    """One delivery, handled; a tuple, since it is made at every delivery.

    Attributes:
        begun_ns: host monotonic time.
        samples: sets of counts that it contained.
        late_ns: from the reader thread's receipt to the beginning; null where the
            delivery has no time.
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
        gc.callbacks.append(self._time)
        return self

    def __exit__(self, *_: object) -> None:
        gc.callbacks.remove(self._time)

    def _time(self, phase: str, _info: dict[str, int]) -> None:
        now_ns = time.monotonic_ns()
        if phase == "start":
            self._begun_ns = now_ns
        elif self._begun_ns:
            self.total_ns += now_ns - self._begun_ns
            self._latencies.add(now_ns - self._begun_ns)
            self._begun_ns = 0


class CycleLog:
    """Ring buffer of the last cycles.

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

    def record(
        self, device: str, delivery: Delivery, begun_ns: int, queue: int
    ) -> None:
        """Record a delivery that has just been handled."""
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

    def report(self, reason: str) -> "CycleReport":
        """Copy what the buffer holds now; takes next to no time."""
        now_ns, offset_ns = self._clock.monotonic_ns(), self._clock.utc_offset_ns()
        return CycleReport(tuple(self._ring), reason, now_ns + offset_ns, offset_ns)


@dataclass(frozen=True, slots=True)
class CycleReport:
    """Cycles of a moment, and why they were copied."""

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


def write_report(folder: Path, report: CycleReport) -> Path:
    """Write a report beside the latest others; the oldest go. For a thread.

    Raises:
        OSError: it cannot be written.
    """
    moment = time.gmtime(report.time_ns // 1_000_000_000)
    millis = report.time_ns // 1_000_000 % 1000
    name = f"cycles-{time.strftime('%Y%m%dT%H%M%S', moment)}.{millis:03d}Z.json"
    path = folder / name
    unfinished = path.with_suffix(".part")
    with unfinished.open("w", encoding="utf-8") as file:
        file.writelines(report.lines())
    unfinished.replace(path)
    for old in sorted(folder.glob(PATTERN))[:-FILES]:
        old.unlink(missing_ok=True)
    return path


class CycleReports:
    """Write a report after a fault, and one at the end.

    Args:
        cycles: what is reported.
        folder: where reports are written.
        clock: the host's.
    """

    def __init__(self, cycles: CycleLog, folder: Path, clock: HostClock) -> None:
        self._cycles = cycles
        self._folder = folder
        self._clock = clock
        self._reported_ns: int | None = None
        self._writing: asyncio.Task[None] | None = None
        self._is_finished = False

    def on_event(self, what: Occurrence) -> None:
        """Write a report if this event is a fault."""
        is_fault = what.severity == "error" and what.active is not False
        if not is_fault or self._is_finished:
            return
        now_ns = self._clock.monotonic_ns()
        if self._reported_ns is None or now_ns - self._reported_ns >= REPORT_NS:
            self._reported_ns = now_ns
            reason = f"{what.code} [{what.source}]: {what.text}"
            self._writing = asyncio.create_task(self._write(reason))

    def close(self) -> None:
        """Write no report of a fault from now on."""
        self._is_finished = True

    async def finish(self, reason: str) -> None:
        """Write the last report, after the one that is being written."""
        if self._writing is not None:
            await self._writing
        await self._write(reason)

    async def _write(self, reason: str) -> None:
        report = self._cycles.report(reason)
        if not report.cycles:
            return
        try:
            path = await asyncio.to_thread(write_report, self._folder, report)
        except OSError as error:
            log.warning("cycles cannot be written to %s: %s", self._folder, error)
        else:
            log.info("the last cycles are in %s", path)
