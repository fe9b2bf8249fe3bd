"""Samples of a polled stream: schedule, and blocks."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from traverse.drivers.base.values import STATUS_MISSING, CountSamples, PolledSample
from traverse.drivers.polling.channel import EncoderReading

BLOCK_NS = 10_000_000
MOST_HELD_NS = 15_000_000  # far below what a sample waits for those of other devices
MOST_LATE = 0.5  # periods that a sample may begin late; after one it is skipped
MAX_SKEW_NS = 2**31 - 1


class SampleSchedule:
    """Instant k is ``begin + k / rate``, so that nothing drifts."""

    def __init__(self, rate_hz: float, begin_ns: int) -> None:
        self._period_ns = 1e9 / rate_hz
        self._begin_ns = begin_ns
        self._next = 0

    @property
    def next_ns(self) -> int:
        return self._instant_ns(self._next)

    @property
    def skipped_ns(self) -> int:
        """When the next sample will have been skipped, with a margin."""
        return self._instant_ns(self._next) + round(MOST_LATE * self._period_ns)

    def take(self, now_ns: int) -> tuple[int, int, int]:
        """Return the latest due sample: number, instant, how many were skipped."""
        number = max(self._next, int((now_ns - self._begin_ns) / self._period_ns))
        skipped = number - self._next
        self._next = number + 1
        return number, self._instant_ns(number), skipped

    def _instant_ns(self, number: int) -> int:
        return self._begin_ns + round(number * self._period_ns)


def sample_of_readings(
    instant_ns: int,
    readings: Sequence[EncoderReading | None],
    last_counts: Sequence[int],
    received_ns: int,
) -> PolledSample:
    """Combine the readings of one cycle.

    A missing reading is replaced by the last count, at the time of its time-out.
    """
    given_up = EncoderReading(0, received_ns, STATUS_MISSING)
    read = [reading or given_up for reading in readings]
    skew_ns = tuple(min(r.time_ns - instant_ns, MAX_SKEW_NS) for r in read)
    status = tuple(r.status for r in read)
    bounds_ns = tuple(r.bound_ns for r in read)
    return PolledSample(
        *(instant_ns, received_ns, instant_ns, 0, tuple(last_counts), status, skew_ns),
        skew_bound_ns=bounds_ns,
        time_bound_ns=max(bounds_ns, default=0),
    )


class SampleBlockBuilder:
    """Samples that wait to be delivered together.

    Where no check sum protects bytes, the next ones often show first that a line is
    disturbed. There a sample of a quick stream waits for the next one, and takes over
    what marks it.
    """

    def __init__(self, device: str, put: Callable[[CountSamples], bool]) -> None:
        self._device, self._put = device, put
        self._waiting: list[tuple[int, PolledSample]] = []
        self._held: tuple[int, PolledSample] | None = None
        self._holds = False

    def begin(self, rate_hz: float, *, is_checked: bool) -> None:
        """Begin a stream; ``is_checked``: a check sum protects its readings."""
        self._holds = not is_checked and rate_hz * MOST_HELD_NS >= 1e9

    def add(self, seq: int, sample: PolledSample, doubts: int = 0) -> None:
        """Add a sample; ``doubts`` are bits ``STATUS_*`` for the one before it."""
        self._release(doubts)
        if self._holds:
            self._held = seq, sample
        else:
            self._waiting.append((seq, sample))

    def is_due(self, now_ns: int) -> bool:
        """Return whether the oldest sample has waited long enough."""
        if self._held and now_ns - self._held[1].time_ns >= MOST_HELD_NS:
            self._release()
        return bool(self._waiting) and now_ns - self._waiting[0][1].time_ns >= BLOCK_NS

    def _release(self, doubts: int = 0) -> None:
        if self._held is None:
            return
        (seq, sample), self._held = self._held, None
        if doubts:
            status = tuple(bits | doubts for bits in sample.status)
            sample = replace(sample, status=status)
        self._waiting.append((seq, sample))

    def finish(self, stream: int, doubts: int = 0) -> None:
        """Deliver all, since no next sample will come."""
        self._release(doubts)
        self.deliver(stream)

    def deliver(self, stream: int) -> None:
        if not self._waiting:
            return
        seq = [number for number, _ in self._waiting]
        samples = [sample for _, sample in self._waiting]
        self._waiting.clear()
        skews_ns = [s.skew_ns for s in samples if s.skew_ns is not None]
        bounds_ns = [s.skew_bound_ns for s in samples if s.skew_bound_ns is not None]
        self._put(
            CountSamples(
                self._device,
                stream,
                seq=np.array(seq, dtype=np.int64),
                device_ticks=np.array([s.ticks for s in samples], dtype=np.int64),
                received_ns=samples[-1].received_ns,
                sample_time_ns=np.array([s.time_ns for s in samples], dtype=np.int64),
                inputs=np.array([s.inputs for s in samples], dtype=np.uint8),
                counts=np.array([s.counts for s in samples], dtype=np.uint32),
                status=np.array([s.status for s in samples], dtype=np.uint8),
                skew_ns=np.array(skews_ns, dtype=np.int32) if skews_ns else None,
                skew_bound_ns=np.array(bounds_ns, dtype=np.int32)
                if bounds_ns
                else None,
                time_bound_ns=max(s.time_bound_ns for s in samples),
            )
        )
