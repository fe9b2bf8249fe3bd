"""Samples of a polled stream: when they are due, and gathered into blocks."""

from collections.abc import Sequence

import numpy as np

from traverse.drivers.base.values import STATUS_MISSING, CountSamples
from traverse.drivers.polling.channel import EncoderReading

BLOCK_NS = 10_000_000
MAX_SKEW_NS = 2**31 - 1


class SampleSchedule:
    """Instant k is ``begin + k / rate``, so that nothing drifts.

    Args:
        rate_hz: of the stream.
        begin_ns: its first instant.
    """

    def __init__(self, rate_hz: float, begin_ns: int) -> None:
        self._period_ns = 1e9 / rate_hz
        self._begin_ns = begin_ns
        self._next = 0

    @property
    def next_ns(self) -> int:
        """The instant of the next sample."""
        return self._instant_ns(self._next)

    def take(self, now_ns: int) -> tuple[int, int, int]:
        """The latest sample that is due: number, instant, how many were skipped."""
        number = max(self._next, int((now_ns - self._begin_ns) / self._period_ns))
        skipped = number - self._next
        self._next = number + 1
        return number, self._instant_ns(number), skipped

    def _instant_ns(self, number: int) -> int:
        return self._begin_ns + round(number * self._period_ns)


class SampleBlockBuilder:
    """Rows of samples that wait to be delivered together.

    Args:
        device: id in the configuration.
    """

    def __init__(self, device: str) -> None:
        self._device = device
        self._seq: list[int] = []
        self._instants_ns: list[int] = []
        self._counts: list[Sequence[int]] = []
        self._status: list[Sequence[int]] = []
        self._skew_ns: list[Sequence[int]] = []
        self._received_ns = 0

    def add(
        self,
        seq: int,
        instant_ns: int,
        readings: Sequence[EncoderReading | None],
        last_counts: Sequence[int],
        received_ns: int,
    ) -> None:
        """Take a sample.

        Where there is no reading its last count replaces it, at the time at
        which it was given up.
        """
        given_up = EncoderReading(0, received_ns, STATUS_MISSING)
        read = [reading or given_up for reading in readings]
        self._seq.append(seq)
        self._instants_ns.append(instant_ns)
        self._counts.append(last_counts)
        self._status.append([reading.status for reading in read])
        self._skew_ns.append(
            [min(reading.time_ns - instant_ns, MAX_SKEW_NS) for reading in read]
        )
        self._received_ns = received_ns

    def is_due(self, now_ns: int) -> bool:
        """Whether the oldest sample has waited long enough."""
        return bool(self._seq) and now_ns - self._instants_ns[0] >= BLOCK_NS

    def take(self, stream: int) -> CountSamples | None:
        """All of them as a block of ``stream``, and begin anew."""
        if not self._seq:
            return None
        n = len(self._seq)
        instants_ns = np.array(self._instants_ns, dtype=np.int64)
        samples = CountSamples(
            self._device,
            stream,
            seq=np.array(self._seq, dtype=np.int64),
            device_ticks=instants_ns,
            received_ns=self._received_ns,
            sample_time_ns=instants_ns,
            inputs=np.zeros(n, dtype=np.uint8),
            counts=np.array(self._counts, dtype=np.uint32),
            status=np.array(self._status, dtype=np.uint8),
            skew_ns=np.array(self._skew_ns, dtype=np.int32),
        )
        for rows in (self._seq, self._instants_ns, self._counts, self._status):
            rows.clear()
        self._skew_ns.clear()
        return samples
