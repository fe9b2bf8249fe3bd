"""Base class of drivers: a reader thread that connects, serves, and reconnects.

A driver overrides `_connect`, `_serve` and `_disconnect`, which run in its thread.
Requests of the service are executed by the same thread, so that only one touches the
port. Any failure in the thread reaches the consumer as a `DeviceLost`.
"""

import contextlib
import logging
import math
import os
import threading
import time
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable
from typing import ClassVar, Self

from traverse.drivers.base.delivery_queue import DeliveryQueue
from traverse.drivers.base.heartbeat import Heartbeat
from traverse.drivers.base.values import (
    DeviceCounters,
    DeviceError,
    DeviceFault,
    DeviceLost,
    DeviceUp,
    StreamStarted,
)
from traverse.strict_toml.reader import StrictModel

log = logging.getLogger(__name__)

FIRST_RETRY_S = 0.1
LAST_RETRY_S = 2.0
COUNTERS_S = 0.5
RATE_TOLERANCE = 0.05  # what a device reaches was measured, and is no round number
CONNECT_S = 60.0  # the longest that any device may need to be found and set up
ASK_S = 15.0  # one exchange with a device, repetitions included
CLOSE_S = 10.0


class DriverOptions(StrictModel):
    """Options of one driver: flat keys with units and bounds, validated and frozen."""

    @property
    def where(self) -> str:
        return str(getattr(self, "port", ""))


class Driver(ABC):
    """A device being read; a context manager, or `start` and `close`."""

    options_class: ClassVar[type[DriverOptions]]

    def __init__(
        self,
        device: str,
        options: DriverOptions,
        delivery_queue: DeliveryQueue,
        *,
        monotonic_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self.device = device
        self.options = options
        self._delivery_queue = delivery_queue
        self._now_ns = monotonic_ns
        self._counters: Counter[str] = Counter()
        self._counters_due_ns = 0
        # Written by the service, read by the thread: which stream is requested.
        self._rate_hz = 0.0
        self._streams_requested = 0
        self._streams_begun = self._stream = 0  # the thread's own
        self._stopping = False
        self._wake_lock = threading.Lock()
        self._closed = False
        self._wake_read, self._wake_write = os.pipe2(os.O_NONBLOCK | os.O_CLOEXEC)
        self.heartbeat = Heartbeat(f"reader of {device}", monotonic_ns)
        # One that is stuck must not keep the program from ending.
        self.thread = threading.Thread(
            target=self._run, name=f"driver-{device}", daemon=True
        )
        self._prepare()

    def start(self) -> None:
        self.thread.start()

    def close(self) -> None:
        """End the thread and close the port; may be called again."""
        if self._stopping:
            return
        self._stopping = True
        self._wake()
        if self.thread.ident is not None:
            self.thread.join(CLOSE_S)
            if self.thread.is_alive():
                log.error(
                    "the reader of %s is stuck: it has not ended within %g s and is "
                    "left behind; its port stays open until the program ends",
                    self.device,
                    CLOSE_S,
                )
                return
        with self._wake_lock:
            self._closed = True
            os.close(self._wake_read)
            os.close(self._wake_write)

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(self, *raised: object) -> None:
        self.close()

    def request_stream(self, rate_hz: float) -> None:
        """Stream timed samples at ``rate_hz``; 0 stops the stream."""
        self._rate_hz = rate_hz  # first: the thread reads it when it reads the number
        self._streams_requested += 1
        self._wake()

    def request_latch(self) -> int:
        """Latch once; the returned token is repeated in `LatchedCounts`.

        Raises:
            DeviceError: it cannot, or too many requests are waiting.
        """
        raise DeviceError(
            f"{self.device} cannot latch at a moment of its own; it is only read "
            "time after time",
            "interpolate its stream at that moment",
        )

    def acknowledge(self, token: int) -> None:  # noqa: B027 - few devices keep edges
        """Acknowledge the edge ``token`` to the device."""

    def _prepare(self) -> None:  # noqa: B027 - some have no state of their own
        """Create the state of this driver; called by the constructor."""

    @abstractmethod
    def _connect(self) -> None:
        """Open the port and set the device up; raises DeviceError or OSError."""

    @abstractmethod
    def _serve(self) -> None:
        """Read until stopped; raises DeviceError or OSError when the device is lost."""

    @abstractmethod
    def _disconnect(self) -> None:
        """Close the port if it is open; never raises."""

    def _wake(self) -> None:
        # Once closed, the pipe's number may already be that of another file.
        with self._wake_lock:
            if not self._closed:
                # A full pipe is no loss: the thread wakes all the same.
                with contextlib.suppress(BlockingIOError):
                    os.write(self._wake_write, b"\0")

    def _report_counters(self) -> None:
        self.heartbeat.beat()
        now_ns = self._now_ns()
        if now_ns < self._counters_due_ns:
            return
        self._counters_due_ns = now_ns + int(COUNTERS_S * 1e9)
        self._counters["samples_dropped"] = self._delivery_queue.dropped_samples
        self._counters["reports_dropped"] = self._delivery_queue.dropped_others
        self._delivery_queue.put(DeviceCounters(self.device, dict(self._counters)))

    def _fault(self, code: str, text: str, remedy: str, count: int = 1) -> None:
        self._counters[code] += count
        self._delivery_queue.put(DeviceFault(self.device, code, text, remedy, count))

    def _deliver_state(self, state: DeviceUp | StreamStarted) -> None:
        """Deliver a change of state that the consumer must not miss.

        Raises:
            DeviceError: there was no room; a new connection reports it again.
        """
        if not self._delivery_queue.put(state):
            raise DeviceError(
                f"deliveries of {self.device} are not processed",
                "the daemon is overloaded",
            )

    def _start_stream(
        self,
        requested_hz: float,
        reached_hz: float = math.inf,
        remedy: str = "",
        *,
        possible_hz: float | None = None,
    ) -> float:
        """Report the next stream, no faster than the device; return its rate.

        Args:
            requested_hz: requested rate.
            reached_hz: largest possible rate.
            remedy: for a rate that is too small.
            possible_hz: rate of a device that cannot stream at any rate.
        """
        rate_hz = requested_hz if possible_hz is None else possible_hz
        if requested_hz > reached_hz * (1.0 + RATE_TOLERANCE):
            self._fault(
                "rate_limited",
                f"a stream of {requested_hz:g} Hz is requested, {self.device} reaches "
                f"{reached_hz:.4g} Hz",
                remedy,
            )
        rate_hz = min(rate_hz, reached_hz)
        self._stream += 1
        other_hz = 0.0 if rate_hz == requested_hz else requested_hz
        known_hz = reached_hz if math.isfinite(reached_hz) else 0.0
        self._deliver_state(
            StreamStarted(self.device, self._stream, rate_hz, other_hz, known_hz)
        )
        return rate_hz

    def _run(self) -> None:
        retry_s = FIRST_RETRY_S
        reported = None
        while not self._stopping:
            lost = None
            try:
                self.heartbeat.beat(CONNECT_S)
                self._connect()
                self.heartbeat.beat()
                retry_s, reported = FIRST_RETRY_S, None
                self._serve()
            except (DeviceError, OSError) as error:
                remedy = getattr(error, "remedy", "check cable and power")
                since_ns = getattr(error, "since_ns", 0)
                lost = DeviceLost(self.device, str(error), remedy, since_ns)
            except Exception as error:
                log.exception("fault in the driver of %s", self.device)
                text = f"fault in the driver: {error!r}"
                lost = DeviceLost(self.device, text, "report it with the log")
            finally:
                self._disconnect()
            if (
                lost is not None
                and lost != reported
                and not self._stopping
                and self._delivery_queue.put(lost)  # else reported after the next try
            ):
                self._counters["lost"] += 1
                reported = lost
            self._pause(retry_s)
            retry_s = min(2 * retry_s, LAST_RETRY_S)
        self.heartbeat.idle()

    def _pause(self, seconds: float) -> None:
        until_ns = self._now_ns() + int(seconds * 1e9)
        while not self._stopping and (left_ns := until_ns - self._now_ns()) > 0:
            self.heartbeat.beat()
            time.sleep(min(left_ns * 1e-9, 0.05))
