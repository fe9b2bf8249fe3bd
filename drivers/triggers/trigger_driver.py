"""Base class of drivers of devices that have inputs and no encoders.

An edge is delivered as `LatchedCounts` without counts, at the time of its event; the
daemon interpolates the arm at that instant. The kernel does not store edges once they
are read, so those without room in the queue wait here, bounded.
"""

import select
from abc import abstractmethod
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from os import read

from pydantic import Field

from traverse.drivers.base.driver import Driver, DriverOptions
from traverse.drivers.base.pending_edges import PendingEdges
from traverse.drivers.base.values import DeviceUp, Identity, PolledSample
from traverse.plurals import counted

LOOK_S = 0.5  # at least so often
RETRY_S = 0.02  # while edges wait for room


@dataclass(frozen=True, slots=True)
class DebouncedEdge:
    """A level of an input that held, from ``time_ns``."""

    active: bool
    time_ns: int


class Debounce:
    """One input: an edge counts when the level has held.

    Its time is that of the first change away from the known level, as on a controller
    board, so that debouncing delays the message and not the measurement.
    """

    def __init__(self, hold_ns: int, *, active: bool) -> None:
        self._hold_ns = hold_ns
        self._known = self._level = active
        self._first_ns = self._last_ns = 0
        self._bouncing = False

    def change(self, active: bool, time_ns: int) -> DebouncedEdge | None:
        """Take a change; return the edge before it, if that held until now."""
        held = self.settle(time_ns)
        if active == self._level:
            return held  # a change was lost between; the level is still valid
        if not self._bouncing:
            self._first_ns, self._bouncing = time_ns, True
        self._level, self._last_ns = active, time_ns
        return held

    def settle(self, now_ns: int) -> DebouncedEdge | None:
        if not self._bouncing or now_ns - self._last_ns < self._hold_ns:
            return None
        self._bouncing = False
        if self._level == self._known:
            return None  # it was a glitch
        self._known = self._level
        return DebouncedEdge(self._level, self._first_ns)

    @property
    def due_ns(self) -> int | None:
        """When to check again, if nothing changes until then."""
        return self._last_ns + self._hold_ns if self._bouncing else None


@dataclass(frozen=True, slots=True)
class InputChange:
    """A change of an input, at the host's monotonic time ``time_ns``."""

    number: int
    active: bool
    time_ns: int


class TriggerOptions(DriverOptions):
    """Options of every driver of inputs alone.

    Attributes:
        port: path of the device.
        debounce_us: how long an input must hold its new level.
    """

    port: str = Field(min_length=1)
    debounce_us: int = Field(default=5000, ge=0, le=1_000_000)

    @property
    def hold_ns(self) -> int:
        return self.debounce_us * 1000


class TriggerDriver(Driver):
    """A device with inputs alone.

    A child overrides `_open`, `_levels`, `_changes` and `_disconnect`.
    """

    options: TriggerOptions

    def _prepare(self) -> None:
        self._path = self.options.port
        self._inputs: list[Debounce] = []
        self._waiting = PendingEdges(
            self.device, self._delivery_queue.put, self._fault, self._counters
        )
        self._fd = -1

    def request_stream(self, rate_hz: float) -> None:
        """There is nothing to stream."""

    @abstractmethod
    def _open(self) -> tuple[str, int]:
        """Open the device; return its name and the descriptor to wait for.

        Raises:
            DeviceError: it cannot be opened.
        """

    @abstractmethod
    def _levels(self) -> Sequence[bool]:
        """Return which inputs are active."""

    @abstractmethod
    def _changes(self) -> Iterable[InputChange]:
        """Read waiting events, in order.

        Raises:
            DeviceError, OSError: the device has disappeared.
        """

    # -- in the reader thread -------------------------------------------------

    def _connect(self) -> None:
        name, self._fd = self._open()
        levels = self._levels()
        self._inputs = [Debounce(self.options.hold_ns, active=a) for a in levels]
        identity = Identity(name, "", (), len(self._inputs), 0.0, latches=False)
        active = sum(is_active << number for number, is_active in enumerate(levels))
        self._deliver_state(DeviceUp(self.device, identity, False, active))

    def _serve(self) -> None:
        while not self._stopping:
            ready, _, _ = select.select(
                [self._fd, self._wake_read], [], [], self._patience_s()
            )
            if self._wake_read in ready:
                with suppress(BlockingIOError):
                    read(self._wake_read, 4096)
            if self._fd in ready:
                for change in self._changes():
                    edge = self._inputs[change.number].change(
                        change.active, change.time_ns
                    )
                    self._note(change.number, edge)
            now_ns = self._now_ns()
            for number, debounce in enumerate(self._inputs):
                self._note(number, debounce.settle(now_ns))
            self._waiting.hand_over()
            self._report_counters()

    def _patience_s(self) -> float:
        if self._waiting:
            return RETRY_S
        due_ns = [
            waiting.due_ns for waiting in self._inputs if waiting.due_ns is not None
        ]
        if not due_ns:
            return LOOK_S
        return min(LOOK_S, max(0.0, (min(due_ns) - self._now_ns()) * 1e-9))

    def _note(self, number: int, edge: DebouncedEdge | None) -> None:
        if edge is None:
            return
        sample = PolledSample(edge.time_ns, self._now_ns(), edge.time_ns, 0, (), ())
        self._waiting.add(number, edge.active, sample)

    def _lose_edges(self, count: int, why: str) -> None:
        self._fault(
            "edges_lost",
            f"{counted(count, 'edge')} or more of {self.device} lost: {why}",
            "repeat the last points",
            count,
        )
