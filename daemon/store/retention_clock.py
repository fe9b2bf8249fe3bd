"""The clock by which stored messages age.

Sent messages are removed when old, but a clock that is wrong once must remove nothing.
Age is counted against the latest trusted time, which is stored, never runs back, and
follows the computer's clock by at most a day in a minute, and not in the first minutes
of a run, in which a clock is often set.
"""

from traverse.daemon.clock import HostClock

FIRST_NS = 300 * 10**9
CATCH_UP = 24 * 60  # a day in a minute


class RetentionClock:
    """Follows the computer's UTC slowly.

    Attributes:
        is_believed: UTC can be trusted, as the service states.
    """

    def __init__(self, clock: HostClock) -> None:
        self._clock = clock
        self._begun_ns = self._looked_ns = clock.monotonic_ns()
        self.is_believed = False

    def advanced(self, stored_ns: int) -> int:
        """Advance the stored time; 0 while there is none."""
        now_ns = self._clock.monotonic_ns()
        passed_ns, self._looked_ns = now_ns - self._looked_ns, now_ns
        if not self.is_believed or now_ns - self._begun_ns < FIRST_NS:
            return 0
        utc_ns = self._clock.to_utc_ns(now_ns)
        if not stored_ns:
            return utc_ns
        return max(stored_ns, min(utc_ns, stored_ns + CATCH_UP * passed_ns))
