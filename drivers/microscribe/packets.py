"""Times of a MicroScribe's packets.

A packet is latched after its request has left and before its answer begins; time on the
line is known, the rest is split evenly. The arm's own timer improves it: its rate and
offset are learned, so that delays of host and adapter do not count. A timer that does
not run nearly as expected is not used.
"""

import math
from collections import deque
from collections.abc import Sequence
from itertools import combinations

from traverse.drivers.microscribe.line import TimedPacket
from traverse.drivers.timing.device_clock import MAX_BOUND_NS, DeviceClock

MAX_TIMER_ERROR = 0.2
RATE_KNOWN = 3e-4  # so closely the rate is learned here; `DeviceClock` learns the rest
LATEST = 64  # packets, of which the quickest bounds when the next ones were latched


class TimerRate:
    """Bounds of a timer's rate, from the exchanges in which its ticks were latched.

    Between two latches at least one tick less, and at most one more, passed than their
    counts differ by; their times are bounded by request and answer. Each is compared
    with an earlier one whose bounds are narrow.

    Args:
        rate_hz: nominal; the true one is within `MAX_TIMER_ERROR`.

    Attributes:
        assumed_hz: nominal, as long as possible; else the middle of the bounds.
    """

    def __init__(self, rate_hz: float) -> None:
        self._stated_hz = rate_hz
        self._narrow: tuple[int, TimedPacket] | None = None
        self.reset()

    def reset(self) -> None:
        self.assumed_hz = self._stated_hz
        self.low_hz = self._stated_hz * (1.0 - MAX_TIMER_ERROR)
        self.high_hz = self._stated_hz * (1.0 + MAX_TIMER_ERROR)
        self._narrow = None

    def add(self, ticks: int, timed: TimedPacket) -> bool:
        """Learn from a packet with unwrapped ticks; False if they jumped."""
        if self._narrow is None:
            self._narrow = ticks, timed
        narrow_ticks, narrow = self._narrow
        low_hz, high_hz = _rate_bounds(narrow, timed, ticks - narrow_ticks)
        if 2 * _exchange_ns(timed) < _exchange_ns(narrow):
            self._narrow = ticks, timed
        slack_hz = RATE_KNOWN * self._stated_hz
        if self.high_hz - self.low_hz < slack_hz:
            # Unless an answer to an earlier request has spoilt a bound before.
            return low_hz < self.high_hz + slack_hz and high_hz > self.low_hz - slack_hz
        self.low_hz = max(self.low_hz, low_hz)
        self.high_hz = min(self.high_hz, high_hz)
        if not self.low_hz <= self.assumed_hz <= self.high_hz:
            self.assumed_hz = (self.low_hz + self.high_hz) / 2.0
        return self.low_hz <= self.high_hz


class PacketClock:
    """Time of a latch on the host's clock.

    Args:
        rate_hz: nominal, of the arm's timer; 0 to leave it unused.
        wrap: where the timer returns to 0.
        delay_ns: least time from the latch to the first bytes.

    Attributes:
        steps: how often the timer jumped.
        bound_ns: error of the last packet's time.
    """

    def __init__(self, rate_hz: float, wrap: int, delay_ns: int) -> None:
        self._delay_ns, self._wrap = delay_ns, wrap
        self._last_ns = 0
        self._latest: deque[tuple[int, int]] = deque(maxlen=LATEST)  # ticks, begun_ns
        self._rate = TimerRate(rate_hz) if rate_hz else None
        self._clock = DeviceClock(rate_hz or 1.0)
        self._clock_hz = rate_hz
        self._clock_steps = self.steps = self.bound_ns = 0
        self.is_uncertain = False

    @property
    def rate_hz(self) -> float:
        return self._rate.assumed_hz if self._rate else 0.0

    def is_old(self, timed: TimedPacket) -> bool:
        if self._rate is None:
            return False
        ticks, most_tick_ns = self._ticks(timed), 1e9 / self._rate.low_hz
        return any(
            begun_ns + (ticks - earlier + 1) * most_tick_ns < timed.sent_ns
            for earlier, begun_ns in self._latest
        )

    def time_of(self, timed: TimedPacket) -> tuple[int, int]:
        """Return unwrapped ticks and the host's time of a packet; learns from it."""
        ticks, time_ns = self._time_of(timed)
        # Requested, latched, begun: between the first and the last it must have been.
        self.bound_ns = max(time_ns - timed.sent_ns, timed.begun_ns - time_ns)
        if self._rate is not None:
            clock_ns = self._clock.error_bound_ns + self._delay_ns
            self.bound_ns = min(self.bound_ns, clock_ns)
        self.is_uncertain = self.bound_ns > MAX_BOUND_NS or (
            timed.is_reported and self._rate is not None and self._clock.is_uncertain
        )
        return ticks, time_ns

    def _time_of(self, timed: TimedPacket) -> tuple[int, int]:
        time_ns = timed.begun_ns - timed.delay_ns
        # Packets arrive in the order in which they were latched.
        earliest_ns = min(max(timed.sent_ns, self._last_ns), timed.begun_ns)
        if self._rate is None:
            self._last_ns = time_ns = max(time_ns, earliest_ns)
            return time_ns, time_ns
        ticks = self._ticks(timed)
        if not self._rate.add(ticks, timed):
            self.steps += 1
            self._rate.reset()
            self._latest.clear()
        self._latest.append((ticks, timed.begun_ns))
        if self._rate.assumed_hz != self._clock_hz:
            self._clock_hz = self._rate.assumed_hz
            self._clock, self._clock_steps = DeviceClock(self._clock_hz), 0
        clock = self._clock
        sent_ns = None if timed.is_reported else timed.sent_ns
        clock.update(ticks, timed.begun_ns, sent_ns)
        self.steps += clock.steps - self._clock_steps
        self._clock_steps = clock.steps
        # The tick had begun and the next one had not. Where in it is known to the host
        # better: requests may run in step with the timer, then ticks never show it.
        tick_ns = clock.to_ns(ticks) - self._delay_ns
        time_ns = min(max(time_ns, tick_ns), tick_ns + round(1e9 / self._clock_hz))
        self._last_ns = time_ns = min(max(time_ns, earliest_ns), timed.begun_ns)
        return ticks, time_ns

    def _ticks(self, timed: TimedPacket) -> int:
        """Unwrap the timer: nearest to the ticks of the last packet."""
        timer = timed.packet.timer or 0
        if not self._latest:
            return timer
        last, half = self._latest[-1][0], self._wrap // 2
        return last + (timer - last + half) % self._wrap - half


def timer_runs(packets: Sequence[TimedPacket], rate_hz: float, wrap: int) -> bool:
    """Return whether the timer may run at a rate, by most pairs of packets.

    Not by all: after a suspension of the host, a reply is matched with a later request.
    """
    possible = []
    for earlier, later in combinations(packets, 2):
        passed = ((later.packet.timer or 0) - (earlier.packet.timer or 0)) % wrap
        low_hz, high_hz = _rate_bounds(earlier, later, passed)
        possible.append(
            low_hz <= rate_hz * (1.0 + MAX_TIMER_ERROR)
            and high_hz >= rate_hz * (1.0 - MAX_TIMER_ERROR)
        )
    return 2 * sum(possible) >= len(possible)


def _exchange_ns(timed: TimedPacket) -> int:
    return timed.begun_ns - timed.sent_ns


def _rate_bounds(
    earlier: TimedPacket, later: TimedPacket, passed: int
) -> tuple[float, float]:
    """Return least and greatest rate [Hz] of a timer that advanced by some ticks."""
    most_ns = max(1, later.begun_ns - earlier.sent_ns)
    least_ns = later.sent_ns - earlier.begun_ns
    high_hz = (passed + 1) * 1e9 / least_ns if least_ns > 0 else math.inf
    return (passed - 1) * 1e9 / most_ns, high_hz
