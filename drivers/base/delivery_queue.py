"""The bounded queue from a reader thread to the event loop.

If the loop does not keep up, timed samples are dropped and counted; edges are refused
(the device repeats them); other deliveries are rare and small, and counted when
dropped. Changes of state, which nothing repeats, have room of their own.

Waking the loop costs more than a sample. Timed samples are collected, in the driver or
here, and wake it at most once in `wake_interval_ns`. Edges and other
deliveries wake it at once, unless a wake-up is pending.
"""

import asyncio
import contextlib
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator

from traverse.drivers.base.values import (
    CountSamples,
    Delivery,
    DeviceLost,
    DeviceUp,
    LatchedCounts,
    StreamStarted,
)

BATCH_WINDOW_NS = 52_000_000
MAX_JOINED_SAMPLES = 500  # samples; more than arrive in that time, at any rate
RESERVED_FOR_STATES = 64


class DeliveryQueue:
    """A bounded queue with one producing thread and one consuming event loop.

    ``max_others`` bounds all deliveries but timed samples.

    Attributes:
        batch_window_ns: collection time of samples; set by the consumer.
        always_wakes: every report wakes the loop; set by the consumer, who takes points
            of releases, too.
        taken: number of takes by the consumer.
        dropped_samples: timed samples dropped because the loop did not keep up.
        dropped_others: reports dropped likewise; never latches.
    """

    def __init__(
        self,
        loop: asyncio.AbstractEventLoop,
        max_samples: int = 50_000,
        max_others: int = 256,
        monotonic_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self._loop = loop
        self.max_samples = max_samples
        self._max_others = max_others
        self._now_ns = monotonic_ns
        self.batch_window_ns = BATCH_WINDOW_NS
        self.always_wakes = False
        self._woken_ns = 0
        self._is_woken = False
        self._gathers = self._is_wake_due = False  # the producer's own
        self._lock = threading.Lock()
        self._waiting: deque[Delivery] = deque()
        self.waiting_samples = 0
        self._waiting_others = 0
        self._filled = asyncio.Event()
        self._on_filled: Callable[[], None] = lambda: None
        self.dropped_samples = 0
        self.dropped_others = 0
        self.taken = 0

    @property
    def is_due(self) -> bool:
        """Whether the consumer was woken and has not taken anything since."""
        return self._filled.is_set()

    @property
    def wake_interval_ns(self) -> int:
        """Least time between wake-ups for samples.

        Not quite the window: a driver that gathers as long wakes the loop each time.
        """
        return self.batch_window_ns * 4 // 5

    def put(self, delivery: Delivery, *, wakes: bool = True) -> bool:
        """Append a delivery from the reader thread; False if there is no room.

        With ``wakes`` False it waits for the next that wakes the loop, or for `wake`.
        """
        with self._lock:
            if isinstance(delivery, CountSamples):
                size = len(delivery.seq)
                if self.waiting_samples + size > self.max_samples:
                    self.dropped_samples += size
                    return False
                self.waiting_samples += size
                wake = self._now_ns() - self._woken_ns >= self.wake_interval_ns
            else:
                state = isinstance(delivery, (DeviceUp, DeviceLost, StreamStarted))
                room = self._max_others + RESERVED_FOR_STATES * state
                if self._waiting_others >= room:
                    if not isinstance(delivery, LatchedCounts):
                        self.dropped_others += 1
                    return False
                self._waiting_others += 1
                wake = wakes or self.always_wakes
            self._waiting.append(delivery)
            wake = wake and not self._is_woken
            if wake:
                self._is_woken = True
                self._woken_ns = self._now_ns()
        return not wake or self._wake_loop()

    def wake(self) -> None:
        with self._lock:
            wake = self._waiting_others > 0 and not self._is_woken
            if wake:
                self._is_woken = True
                self._woken_ns = self._now_ns()
        if wake:
            self._wake_loop()

    @contextlib.contextmanager
    def together(self) -> Iterator[None]:
        """Wake the loop at the end of the block.

        Woken earlier, it would compete for the interpreter.
        """
        self._gathers = True
        try:
            yield
        finally:
            self._gathers = False
            if self._is_wake_due:
                self._wake_loop()

    def _wake_loop(self) -> bool:
        self._is_wake_due = self._gathers
        if not self._gathers:
            try:
                self._loop.call_soon_threadsafe(self._wake)
            except RuntimeError:  # the loop is closed: this will never be read
                return False
        return True

    @contextlib.contextmanager
    def notifying(self, on_filled: Callable[[], None]) -> Iterator[None]:
        """Call a function when waiting deliveries should be taken, within the block."""
        self._on_filled = on_filled
        if self.is_due:
            on_filled()
        try:
            yield
        finally:
            self._on_filled = lambda: None

    def _wake(self) -> None:
        self._filled.set()
        self._on_filled()

    async def take(self) -> list[Delivery]:
        """Wait for deliveries and take all, in order."""
        await self._filled.wait()
        return self.take_waiting()

    def take_waiting(self) -> list[Delivery]:
        """Take all waiting deliveries, in order.

        Consecutive samples of one stream are joined into a block, after a stall into
        several: computing a block takes a hundred times its memory, which is never
        fully released.
        """
        self.taken += 1
        with self._lock:
            self._filled.clear()
            self._is_woken = False
            deliveries = list(self._waiting)
            self._waiting.clear()
            self.waiting_samples = 0
            self._waiting_others = 0
        return list(_joined(deliveries))


def _joined(deliveries: Iterable[Delivery]) -> Iterator[Delivery]:
    run: list[CountSamples] = []
    n = 0
    for delivery in deliveries:
        size = len(delivery.seq) if isinstance(delivery, CountSamples) else 0
        if run and (
            n + size > MAX_JOINED_SAMPLES or _stream(delivery) != run[0].stream
        ):
            yield CountSamples.joined(run)
            run, n = [], 0
        if isinstance(delivery, CountSamples):
            run.append(delivery)
            n += size
        else:
            yield delivery
    if run:
        yield CountSamples.joined(run)


def _stream(delivery: Delivery) -> int:
    """Return the stream of samples, from 1; 0 for other deliveries."""
    return delivery.stream if isinstance(delivery, CountSamples) else 0
