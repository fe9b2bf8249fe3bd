"""The time of a MicroScribe's packets.

A packet is latched after its request has left and before its answer begins; how much
of that is time on the line is known, the rest is taken to be the same both ways. The
arm's own timer improves it: it advances by ticks whose rate and offset are learned,
so that what the host or an adapter held back does not count. A timer that does not run
as expected is left alone.
"""

from collections.abc import Sequence

from traverse.drivers.microscribe.line import TimedPacket
from traverse.drivers.timing.device_clock import DeviceClock

EARLY_NS = 5_000_000  # latched so long before its request: an answer to an earlier one
MAX_TIMER_ERROR = 0.2


class PacketClock:
    """When a packet was latched, on the host's clock.

    Args:
        rate_hz: of the arm's timer; 0 where it is not to be used.
        wrap: where the timer returns to 0.
        delay_ns: from the latch to the first bytes, where nothing is held back.
    """

    def __init__(self, rate_hz: float, wrap: int, delay_ns: int) -> None:
        self._delay_ns = delay_ns
        self._last_ns = 0
        self._clock = DeviceClock(rate_hz, wrap) if rate_hz else None
        self._tick_ns = round(1e9 / rate_hz) if rate_hz else 0

    @property
    def steps(self) -> int:
        """How often the timer has jumped."""
        return self._clock.steps if self._clock else 0

    def is_old(self, heard: TimedPacket) -> bool:
        """Whether a packet was latched before it was requested."""
        if self._clock is None or not self._clock.running:
            return False
        begins_ns = self._clock.to_ns(self._ticks(self._clock, heard)) - self._delay_ns
        ends_ns = begins_ns + self._tick_ns
        return ends_ns + EARLY_NS < heard.sent_ns

    def time_of(self, heard: TimedPacket) -> tuple[int, int]:
        """Unwrapped ticks and the host's time of a packet; learns from it."""
        time_ns = heard.begun_ns - heard.delay_ns
        # Packets arrive in the order in which they were latched.
        earliest_ns = min(max(heard.sent_ns, self._last_ns), heard.begun_ns)
        if self._clock is None:
            self._last_ns = time_ns = max(time_ns, earliest_ns)
            return time_ns, time_ns
        ticks = self._ticks(self._clock, heard)
        self._clock.update(ticks, heard.begun_ns)
        # The tick had begun and the next one had not. Where in it the host knows
        # better: requests may keep step with the timer, and then ticks never show it.
        tick_ns = self._clock.to_ns(ticks) - self._delay_ns
        time_ns = min(max(time_ns, tick_ns), tick_ns + self._tick_ns)
        self._last_ns = time_ns = min(max(time_ns, earliest_ns), heard.begun_ns)
        return ticks, time_ns

    def _ticks(self, clock: DeviceClock, heard: TimedPacket) -> int:
        return clock.unwrap_one(heard.packet.timer or 0)


def timer_runs(heard: Sequence[TimedPacket], rate_hz: float, wrap: int) -> bool:
    """Whether the arm's timer runs at a rate, judged by the first and last packet."""
    first, last = heard[0], heard[-1]
    elapsed_s = (last.begun_ns - first.begun_ns) * 1e-9
    ticks = ((last.packet.timer or 0) - (first.packet.timer or 0)) % wrap
    return abs(ticks - elapsed_s * rate_hz) <= MAX_TIMER_ERROR * elapsed_s * rate_hz + 2
