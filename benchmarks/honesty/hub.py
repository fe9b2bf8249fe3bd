"""Virtual time of a world: devices, readers and the event loop take turns in it.

One thread works. The reader of each driver is a greenlet in the place of its thread: it
runs until it waits for bytes or time. When readers and event loop wait, time advances
to the next action of a device, arrival of bytes or end of a wait. Computing takes no
time; stalls are drawn.
"""

import heapq
import itertools
from collections.abc import Callable
from dataclasses import dataclass

from greenlet import GreenletExit, getcurrent, greenlet

from benchmarks.honesty.cable import NEVER_S, Cable
from benchmarks.honesty.timeline import Timeline
from traverse.drivers.base.driver import Driver
from traverse.simulator.devices.device import SimulatedDevice

BOOT_NS = 10**12  # the host's monotonic clock at the true time 0
NUDGE_S = 1e-6  # where something stays due without end
MOST_TURNS = 50
MOST_SPINS = 100_000


class Reader:
    """The reader of a driver: its `_run` in a greenlet."""

    def __init__(self, hub: "Hub", driver: Driver) -> None:
        self._hub, self.driver = hub, driver
        self.due_s = 0.0
        self.ready: Callable[[], bool] = bool
        self.woken = False
        self.wakes = True
        self.greenlet = greenlet(driver._run, parent=hub.main)
        driver._wake = self.wake  # type: ignore[method-assign]  # no pipe, no thread

    def wake(self) -> None:
        self.woken = True

    def can_run(self, now_s: float) -> bool:
        """Return whether its wait is over."""
        return self.due_s <= now_s or (self.wakes and self.woken) or self.ready()


@dataclass(slots=True, eq=False)
class Housed:
    """A device in a world.

    Attributes:
        due_s: next action of its own; changes only while it lives.
    """

    device: SimulatedDevice
    cables: list[Cable]
    due_s: float = 0.0

    def next_s(self) -> float:
        """Return when it has something to do or to read."""
        next_s = self.due_s
        for cable in self.cables:
            next_s = min(next_s, cable.device_due_s())
        return next_s

    def live(self, now_s: float) -> None:
        self.device.live(now_s)
        for cable in self.cables:
            cable.touched = False
        self.due_s = self.device.next_due_s(0.0)


class Hub:
    """The time, and all that lives in it.

    Args:
        host: The host's clock over true time; it never runs backwards.

    Attributes:
        ports: The host's devices, by path.
        booted_s: Of the host's clock, when the computer was started last.
        readers_stalled_s: Until when no reader runs.
        loop_stalled_s: Until when the event loop does not run.
    """

    def __init__(self, host: Timeline) -> None:
        self.host = host
        self.now_s = 0.0
        self.main = getcurrent()
        self.devices: list[Housed] = []
        self.ports: dict[str, Cable] = {}
        self.cables: list[Cable] = []
        self.readers: list[Reader] = []
        self.booted_s = 0.0
        self.readers_stalled_s = self.loop_stalled_s = 0.0
        self.loop_woken = False
        self._current: Reader | None = None
        self._actions: list[tuple[float, int, Callable[[], object]]] = []
        self._numbers = itertools.count()
        self._spins = 0

    # -- clocks ------------------------------------------------------------------

    @property
    def loop_s(self) -> float:
        """The host's clock, not reset by a restart."""
        return self.host.at(self.now_s)

    def monotonic_ns(self) -> int:
        return BOOT_NS + round(1e9 * (self.loop_s - self.booted_s))

    def true_s(self, monotonic_ns: int) -> float:
        """True time of an instant of the host's monotonic clock."""
        return self.host.true((monotonic_ns - BOOT_NS) * 1e-9 + self.booted_s)

    # -- readers -----------------------------------------------------------------

    def start(self, driver: Driver) -> Reader:
        reader = Reader(self, driver)
        self.readers.append(reader)
        return reader

    def kill(self, reader: Reader) -> None:
        self.readers.remove(reader)
        if not reader.greenlet.dead:
            self._current = reader
            reader.greenlet.throw(GreenletExit)
            self._current = None
        reader.driver.close()

    def wait(self, seconds: float, ready: Callable[[], bool] = bool) -> bool:
        reader = self._current
        if reader is None:
            raise RuntimeError("only readers wait")
        if ready():
            return True
        if reader.woken:
            reader.woken = False
            return False
        if seconds > 0.0:
            self._suspend(reader, seconds, ready)
        if ready():
            return True
        reader.woken = False
        return False

    def sleep(self, seconds: float) -> None:
        if self._current is None:
            raise RuntimeError("the event loop must not sleep")
        self._current.wakes = False
        self._suspend(self._current, seconds, bool)
        self._current.wakes = True

    def _suspend(
        self, reader: Reader, seconds: float, ready: Callable[[], bool]
    ) -> None:
        due_s = self.host.true(self.loop_s + seconds)
        reader.due_s, reader.ready = max(due_s, self.now_s + 1e-9), ready
        self._current = None
        self.main.switch()
        self._current = reader

    # -- time --------------------------------------------------------------------

    def at(self, true_s: float, action: Callable[[], object]) -> None:
        """Call an action at a true time, outside of readers and event loop."""
        heapq.heappush(self._actions, (true_s, next(self._numbers), action))

    def run(self, seconds: float | None) -> None:
        end_s = NEVER_S
        if seconds is not None:
            end_s = max(self.now_s, self.host.true(self.loop_s + seconds))
        turns = 0
        while True:
            self._run_readers()
            is_due = self.loop_woken or self.now_s >= end_s
            if is_due and self.now_s >= self.loop_stalled_s:
                self.loop_woken = False
                return
            next_s = self._next_s()
            if not is_due:
                next_s = min(next_s, end_s)
            elif self.loop_stalled_s > self.now_s:
                next_s = min(next_s, self.loop_stalled_s)
            if next_s == NEVER_S:
                raise RuntimeError("nothing will ever happen again")
            turns = turns + 1 if next_s <= self.now_s else 0
            if turns > MOST_TURNS:
                next_s, turns = self.now_s + NUDGE_S, 0
            self.now_s = max(self.now_s, next_s)
            while self._actions and self._actions[0][0] <= self.now_s:
                heapq.heappop(self._actions)[2]()
            for housed in self.devices:
                if housed.next_s() <= self.now_s:
                    housed.live(self.now_s)

    def _next_s(self) -> float:
        next_s = self._actions[0][0] if self._actions else NEVER_S
        for housed in self.devices:
            next_s = min(next_s, housed.next_s())
        stalled = self.readers_stalled_s > self.now_s
        if stalled:
            next_s = min(next_s, self.readers_stalled_s)
        else:
            for reader in self.readers:
                next_s = min(next_s, reader.due_s)
            for cable in self.cables:
                due_s = cable.host_due_s()
                if due_s > self.now_s:
                    next_s = min(next_s, due_s)
        return next_s

    def _run_readers(self) -> None:
        if self.now_s < self.readers_stalled_s:
            return
        is_called, spins = True, 0
        while is_called:
            is_called = False
            for reader in tuple(self.readers):
                if reader.greenlet.dead or not reader.can_run(self.now_s):
                    continue
                is_called, self._current = True, reader
                reader.due_s = NEVER_S
                reader.greenlet.switch()
                self._current = None
                spins += 1
            if spins > MOST_SPINS:
                raise RuntimeError(f"a reader does not wait at {self.now_s} s")
