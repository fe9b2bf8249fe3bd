"""The instants at which samples of a polled stream are due."""


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
