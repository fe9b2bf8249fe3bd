"""The source of SYNCs, and their schedule.

host      this program sends them between two reads, and stamps them right after
kernel    the kernel's broadcast manager sends them; they are received from the bus
external  another master sends them; they are received from the bus
"""

import contextlib
import math
from collections.abc import Callable

from traverse.drivers.base.values import DeviceError
from traverse.drivers.canopen.options import SyncSource
from traverse.drivers.canopen.sync_cycles import SyncCycleAssembler
from traverse.drivers.io.can_bus import CanBus, PeriodicTask
from traverse.protocol.canopen import frames as wire

FAST_HZ = 400.0
CLOSEST = 0.8  # of a period, between SYNCs that make up for a delay
MOST_BEHIND = 50  # SYNCs that are made up for


class HostSchedule:
    """Sends a SYNC at k / rate.

    A busy computer sends late: then the next ones follow closer until the schedule is
    reached again; only those far behind are skipped.

    The first is sent one period after ``now_ns``.
    """

    def __init__(self, rate_hz: float, now_ns: int) -> None:
        self._period_ns = 1e9 / rate_hz
        self._begin_ns = now_ns
        self._next = 1
        self._earliest_ns = now_ns

    @property
    def due_ns(self) -> int:
        planned_ns = self._begin_ns + round(self._next * self._period_ns)
        return max(planned_ns, self._earliest_ns)

    def take(self, now_ns: int) -> int:
        """Return the steps of the schedule that the present SYNC represents."""
        self._earliest_ns = now_ns + round(CLOSEST * self._period_ns)
        reached = int((now_ns - self._begin_ns) / self._period_ns)
        steps = 1 if reached - self._next < MOST_BEHIND else reached - self._next + 1
        self._next += steps
        return steps


class ObservedSchedule:
    """Numbers received SYNCs, by the time between them if the period is known.

    The kernel's broadcast manager sends one a period after it sent the last, and never
    catches up: delays add up. A schedule at the requested rate would drift away from it
    and find SYNCs missing that were never due.

    The rate is None if it is another master's and unknown.
    """

    def __init__(self, rate_hz: float | None) -> None:
        self._period_ns = None if rate_hz is None else 1e9 / rate_hz
        self._last_ns: int | None = None

    def take(self, time_ns: int) -> int:
        """Return the steps of the schedule from the last SYNC to this one."""
        if self._period_ns is None:
            return 1
        last_ns, self._last_ns = self._last_ns, time_ns
        if last_ns is None:
            return 1
        return max(1, round((time_ns - last_ns) / self._period_ns))


class SyncScheduler:
    """The SYNCs of one connection, from any source.

    ``fault`` takes code, text and remedy of a survived fault.

    Attributes:
        sent: the schedule if this program sends; else None.
        seen: the numbering if SYNCs are received from the bus; else None.
        is_fast: frames are better read together, at their rate.
    """

    def __init__(
        self,
        bus: CanBus,
        requested_source: SyncSource,
        fault: Callable[[str, str, str], None],
        now_ns: Callable[[], int],
    ) -> None:
        self._bus, self._requested_source = bus, requested_source
        self._fault, self._now_ns = fault, now_ns
        self._task: PeriodicTask | None = None
        self.sent: HostSchedule | None = None
        self.seen: ObservedSchedule | None = None
        self.is_fast = False
        self._rate_hz = 0.0
        self._rests = False

    def start(self, rate_hz: float) -> None:
        self.stop()
        self.is_fast = rate_hz > FAST_HZ
        self._rate_hz = rate_hz
        if self._requested_source == "external":
            self.seen = ObservedSchedule(None)
            return
        if self._requested_source != "host" and self._kernel_starts(rate_hz):
            self.seen = ObservedSchedule(rate_hz)
            return
        if self._requested_source == "kernel" or (
            self._requested_source == "auto" and self._bus.has_kernel_sync
        ):
            self._fault(
                "sync_by_host",
                f"the kernel cannot send SYNCs on {self._bus.name}; this program does",
                "load the kernel's module can-bcm, on an interface of SocketCAN",
            )
        self.sent = HostSchedule(rate_hz, self._now_ns())

    def stop(self) -> None:
        self.sent = self.seen = None
        self.is_fast = self._rests = False
        if self._task is not None:
            self._task.stop()
            self._task = None

    def advance(
        self, cycles: SyncCycleAssembler, read_out: Callable[[], None]
    ) -> float:
        """Send a SYNC if it is due and clear; return seconds until the next check.

        Args:
            cycles: notified; know whether answers are awaited.
            read_out: reads frames that have arrived: they belong to the SYNC before.

        Raises:
            DeviceError: the bus does not take it.
        """
        if self.sent is None:
            return self._rest(cycles.pause_until_ns)
        now_ns = self._now_ns()
        if now_ns >= self.sent.due_ns:
            read_out()
            if now_ns < (until_ns := cycles.wait_until_ns):
                return (until_ns - now_ns) * 1e-9
            steps = self.sent.take(now_ns)
            self._bus.send(wire.SYNC, b"")
            now_ns = self._now_ns()
            cycles.sync(now_ns, steps)
        return max(0.0, (self.sent.due_ns - now_ns) * 1e-9)

    def _rest(self, until_ns: int) -> float:
        """Pause the kernel's SYNCs; return seconds until it sends again."""
        left_s = (until_ns - self._now_ns()) * 1e-9
        if self._task is not None and left_s > 0:
            self._task.stop()
            self._task = None
            self._rests = True
        elif self._rests and left_s <= 0:
            self._rests = False
            self._task = self._bus.send_periodically(wire.SYNC, 1.0 / self._rate_hz)
        return left_s if self._rests else math.inf

    def _kernel_starts(self, rate_hz: float) -> bool:
        if self._bus.has_kernel_sync:
            with contextlib.suppress(DeviceError):
                self._task = self._bus.send_periodically(wire.SYNC, 1.0 / rate_hz)
        return self._task is not None
