"""Maps a device's ticks to the host's monotonic clock, with a bound.

A read never happens before the latch, so ``received - ticks / rate`` is the true
offset plus a delay that is never negative; `traverse.drivers.timing.delay_floor` lays
the line below these, whose slope is the error of the device's rate. What remains is the
smallest delay itself, which no one-way measurement separates from the offset: the
configuration of the port states it, as ``latency_ns``. A request and its answer do: the
latch is after the request, so that times are late by no more than the time of that
latch was. Where a port holds bytes back until its next frame, the smallest delay rises
and falls slowly by a frame, as the two clocks pass each other, which no line tells from
an error of the rate: what an answer showed is worth less each second.

So a time is bounded from both sides. It is too late by what the best answer leaves open
(without answers: line and port, which do not show a smallest delay that lasts). It is
too early by as much as the last reading was late, since its latch was before its
arrival. A counter that stood still before that reading is within the latter.

Strategy: a time is in doubt until the line is known, and whenever a reading suggests
that it may not hold any more. A reading near the line proves it: the counter has lost
nothing until then. One that is later than all of the last half minute, or more readings
in a row above the line than ever, may be a busy host, or a counter that stood still:
the next reading near the line decides. If none comes for `STEP_S`, the delays have a
new floor, which is a step of the counter. A reading below the line by more than its
bound is one at once: it would have arrived before its latch.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from traverse.arrays import Integers
from traverse.drivers.timing.delay_floor import LEAST_BINS, DelayFloor, FloorLine

WRAP = 1 << 32
BIN_S = 0.25
EACH_BIN, LATER_BINS = 24, 4  # so long the line is laid anew with each bin; then less
BLEND_S = 0.25  # in which a new line is adopted
STEP_S = 1.5
STEP_READS = 8
FIRST_BINS = 3  # for a first line, of which nothing is certain
UNKNOWN_NS = 1e9
EXCHANGES = 64
# Both outer thirds touch the line, and what touches may be late by a frame. A rate that
# drifts bends the delays to a parabola: at its end the slope differs from that of a
# chord by four times what lies between the two, over the length of the chord.
FRAME_MARGIN, BEND_MARGIN = 1.5, 4.0
MAX_BOUND_NS = 20_000_000  # of what has to be learned; beyond, no time is certain
MAX_TIED_NS = 1_000_000  # of an answer that ties the clock
MAX_RATE_ERROR = 0.025  # as long as the rate is not known
LEARNED_RATE_ERROR = 1e-3  # long after it was learned
LEAST_GAP_NS = 5_000_000_000  # a computer that sleeps for less is no loss of power
GENERATION_NS = 16_000_000_000  # for two of these the usual delays are remembered
LATE_MARGIN, LATE_SLACK_NS = 2.0, 3_000_000
WELL_KNOWN_NS = 500_000  # 0.05 mm of a hand that moves at 100 mm/s
PROOF_SLACK_NS = 500_000  # 0.1 mm of a hand that moves at 200 mm/s
UNDERCUT = 4.0  # bounds below the line: no luck with the delays explains it
LEAST_RUN, RUN_MARGIN = 6, 3
REMEMBERED_READS = 4096  # until the line is known


class _UsualDelays:
    """Remembers usual delays, and usual numbers of successive late readings."""

    def __init__(self) -> None:
        self._since_ns = 0
        self._late_ns = [0.0, 0.0]
        self._run = [0, 0]
        self.set_limits()

    def set_limits(self) -> None:
        """Set the limits beyond which a reading is unusually late."""
        self.limit_ns = LATE_MARGIN * max(self._late_ns) + LATE_SLACK_NS
        self.run_limit = LEAST_RUN + RUN_MARGIN * max(self._run)

    def add(self, late_ns: float, run: int, now_ns: int) -> None:
        """Take the latest of successive late readings before a proof."""
        if now_ns - self._since_ns > GENERATION_NS:
            self._since_ns = now_ns
            self._late_ns = [late_ns, self._late_ns[0]]
            self._run = [run, self._run[0]]
        elif late_ns <= self._late_ns[0] and run <= self._run[0]:
            return
        else:
            self._late_ns[0] = max(self._late_ns[0], late_ns)
            self._run[0] = max(self._run[0], run)
        self.set_limits()


@dataclass(frozen=True, slots=True)
class _Exchange:
    """A latch that was requested.

    Attributes:
        sent_ns: when it had been requested.
    """

    ticks: int
    sent_ns: int


class DeviceClock:
    """Regression of device ticks on host time.

    Args:
        tick_rate_hz: nominal rate of the device's counter.
        wrap: where the counter returns to 0.
        latency_ns: bound on the smallest delay.

    Attributes:
        running: something has been learned, from readings.
        steps: how often the counter, or the host's clock, has jumped or stood still.
    """

    def __init__(
        self, tick_rate_hz: float, wrap: int = WRAP, latency_ns: int = 0
    ) -> None:
        self._ns_per_tick = 1e9 / tick_rate_hz
        self._blend_ticks = max(1, round(BLEND_S * tick_rate_hz))
        self._wrap = wrap
        self._last: int | None = None
        self._stepped_ticks: int | None = None
        self.running = False
        self.steps = 0
        self._slope = 0.0
        self._bins_waited = 0
        self._floor = DelayFloor(BIN_S * 1e9)
        self._usual = _UsualDelays()
        self._tie: tuple[int, float] | None = None  # ticks of a quick answer; how quick
        self._reads: list[tuple[int, int]] = []
        self._exchanges: deque[_Exchange] = deque(maxlen=EXCHANGES)
        self._best: _Exchange | None = None
        self._forgotten_late_ns = 0.0  # by exchanges that hold no longer
        self._late_ns = 0.0  # of the last reading
        self._run = self._read_ns = self._read_ticks = self._proven_ns = 0
        self._run_late_ns = self._height_ns = self._jump_ns = 0.0
        self._line_bound_ns, self._rate_bound = UNKNOWN_NS, MAX_RATE_ERROR
        self._lines: Sequence[FloorLine] = ()
        self.state_latency(latency_ns)
        self._restart(0, 0)

    def state_latency(self, latency_ns: int) -> None:
        """State how large the smallest delay may be."""
        # A bus of frames holds bytes back by more and more of one, then by none again.
        self._grain_ns = float(latency_ns)

    # -- how well it is known --------------------------------------------------

    @property
    def is_known(self) -> bool:
        """Whether rate and smallest delay have been learned since the last step."""
        return self._line_bound_ns < MAX_BOUND_NS

    @property
    def lacks_answer(self) -> bool:
        """Whether answers bounded the smallest delay, and hold no longer."""
        return self._best is None and self._forgotten_late_ns > 0.0

    @property
    def is_well_known(self) -> bool:
        """Whether an answer bounds the times closely enough for an arm that moves."""
        if self._best is None or not self.is_known:
            return False
        return self._late_by_ns(self._best) < WELL_KNOWN_NS

    @property
    def is_uncertain(self) -> bool:
        """Whether times have no bound."""
        if self._line_bound_ns <= MAX_BOUND_NS and not self._run and not self._jump_ns:
            return False  # nearly always
        return self.is_late or self._bound_ns() > MAX_BOUND_NS

    @property
    def is_late(self) -> bool:
        """Whether, by the last read, the counter may have stood still."""
        if not self._run:
            return False
        run_limit = self._usual.run_limit
        return self._run > run_limit or self._is_unusual(self._late_ns)

    def is_unusual(self, ticks: int, received_ns: int) -> bool:
        """Return whether a newer latch was read so late that the counter may stand."""
        late_ns = received_ns - self.to_ns(ticks)
        return self.is_newer(ticks) and self._is_unusual(late_ns)

    def _is_unusual(self, late_ns: float) -> bool:
        limit_ns = LATE_SLACK_NS if self._is_only_tied else self._usual.limit_ns
        return late_ns > limit_ns + self._bound_ns()

    @property
    def _is_only_tied(self) -> bool:
        """Whether a single answer is all that is known: no delay is usual yet."""
        return self._tie is not None and self._line_bound_ns >= UNKNOWN_NS

    @property
    def error_bound_ns(self) -> int:
        """Error of the times of the last read; large while uncertain."""
        bound_ns = max(self._most_late_ns(), self._late_ns) + self._ns_per_tick
        return round(min(bound_ns, UNKNOWN_NS))

    @property
    def rate_error(self) -> float:
        """By how much the device's clock runs fast; 1e-3: 0.1 %."""
        return -self._slope / (1.0 + self._slope)

    def _most_late_ns(self) -> float:
        """Bound by how much the present times are later than their latches."""
        if self._best is not None:
            return self._late_by_ns(self._best)
        return max(self._bound_ns() + self._grain_ns, self._forgotten_late_ns)

    def _forget_exchanges(self, gained_ns: float) -> None:
        """Forget exchanges before a gain of the counter, but not how late times may be.

        Until the next exchange the delay may still be all that the best one left open.
        """
        if self._best is not None:
            self._forgotten_late_ns = self._most_late_ns() + gained_ns
        self._exchanges.clear()
        self._best = None

    def _late_by_ns(self, exchange: _Exchange) -> float:
        """Bound the same by an exchange and the rate's uncertainty since then."""
        last = self._last or 0
        passed_ns = abs(last - exchange.ticks) * self._ns_per_tick
        jump_ns = self._jump_ns * self._share_left(last)
        requested_ns = exchange.sent_ns - jump_ns
        late_ns = self._on_line_ns(exchange.ticks) - requested_ns
        return max(0.0, late_ns) + self._rate_bound * passed_ns

    def _state_rate_bound(self, least_bound_ns: float) -> None:
        """Bound how far the line's slope may be off, by the lines of all windows.

        Args:
            least_bound_ns: of each line.
        """
        frame_ns, self._rate_bound = FRAME_MARGIN * self._grain_ns, MAX_RATE_ERROR
        for line in self._lines:
            bound_ns = max(line.bound_ns, least_bound_ns)
            open_ns = frame_ns + BEND_MARGIN * bound_ns
            slope_bound = abs(line.slope - self._slope) + open_ns / line.span_ns
            self._rate_bound = min(self._rate_bound, slope_bound)

    def is_before_step(self, ticks: int, margin_ns: int = 0) -> bool:
        """Return whether a latch precedes the last step: no line holds there now.

        With a margin also one that is later by no more than that.
        """
        if self._stepped_ticks is None:
            return False
        return ticks - margin_ns / self._ns_per_tick < self._stepped_ticks

    def is_newer(self, ticks: int) -> bool:
        """Return whether a latch, unwrapped, is later than all before."""
        return not self.running or self._last is None or ticks > self._last

    def _bound_ns(self) -> float:
        """Return the bound of the line, and of the remaining way to it."""
        bound_ns = self._line_bound_ns
        last = self._last or 0
        if self._tie is not None:
            ticks, width_ns = self._tie
            passed_ns = abs(last - ticks) * self._ns_per_tick
            bound_ns = min(bound_ns, width_ns + MAX_RATE_ERROR * passed_ns)
        if self._jump_ns:
            bound_ns += abs(self._jump_ns) * self._share_left(last)
        return bound_ns

    @property
    def last(self) -> tuple[int, int] | None:
        """The latest latch: its ticks, unwrapped, and when it was; None without."""
        return None if self._last is None else (self._last, self.to_ns(self._last))

    def is_continued_by(self, ticks: int, at_ns: int) -> bool:
        """Return whether the counter, still counting, may have had ticks at a time."""
        if self.last is None:
            return True
        before, before_ns = self.last
        passed_ns = at_ns - before_ns
        expected = passed_ns / (self._ns_per_tick * (1.0 + self._slope))
        half = self._wrap / 2
        ahead = (ticks - before - expected + half) % self._wrap - half
        share = LEARNED_RATE_ERROR if self.is_known else MAX_RATE_ERROR
        return abs(ahead) * self._ns_per_tick <= LEAST_GAP_NS + share * passed_ns

    # -- learning ----------------------------------------------------------------

    def update(self, ticks: int, received_ns: int, sent_ns: int | None = None) -> None:
        """Learn from a latch.

        Args:
            ticks: of the latch, unwrapped.
            received_ns: when it had been read.
            sent_ns: when it was requested; None without a request.
        """
        if not self.running:
            self._restart(ticks, received_ns)
            self.running = True
        self._last = ticks
        late_ns = float(received_ns - self.to_ns(ticks))
        bound_ns = self._line_bound_ns + self._ns_per_tick
        if self._tie is not None or self._jump_ns:
            bound_ns = self._bound_ns() + self._ns_per_tick
        if late_ns < -UNDERCUT * bound_ns - self._grain_ns or (
            sent_ns is not None
            and late_ns - (received_ns - sent_ns) > bound_ns + self._grain_ns
        ):
            self._step(ticks, received_ns)
        elif self._line_bound_ns < UNKNOWN_NS or self._tie is not None:
            if late_ns < -bound_ns and self._line_bound_ns < UNKNOWN_NS:
                # Delays have been smaller than was seen until now.
                self._line_bound_ns = -2.0 * late_ns
                self._state_rate_bound(self._line_bound_ns)
                # Or the counter has gained, by more the later this reading is.
                self._forget_exchanges(self._usual.limit_ns - late_ns)
            elif late_ns < 0.0 and -late_ns > self._most_late_ns() + self._ns_per_tick:
                # No latch is that early if the best answer still holds.
                self._forget_exchanges(self._usual.limit_ns - late_ns)
            self._judge(ticks, late_ns, received_ns)
        elapsed = ticks - self._anchor_ticks
        elapsed_ns = elapsed * self._ns_per_tick
        offset_ns = received_ns - self._anchor_ns - elapsed_ns
        if self._jump_ns and elapsed >= self._fit_ticks + self._blend_ticks:
            self._jump_ns = 0.0
        # Reads of a host that stood still are not how delays usually are.
        if not (self._run and self.is_late) and self._floor.add(elapsed_ns, offset_ns):
            self._lay_line(ticks)
        if self._line_bound_ns >= UNKNOWN_NS:
            if len(self._reads) < REMEMBERED_READS:
                self._reads.append((ticks, received_ns))
            if offset_ns < self._height_ns + self._slope * elapsed_ns:
                height_ns = offset_ns - self._slope * elapsed_ns
                self._enter(ticks, self._slope, height_ns)
        if sent_ns is not None:
            self._take_exchange(ticks, received_ns, sent_ns)

    def _take_exchange(self, ticks: int, received_ns: int, sent_ns: int) -> None:
        """Bound the smallest delay by a request; a quick answer ties the clock."""
        width_ns = received_ns - sent_ns
        if self._line_bound_ns >= UNKNOWN_NS and width_ns < MAX_TIED_NS:
            elapsed_ns = (ticks - self._anchor_ticks) * self._ns_per_tick
            offset_ns = received_ns - self._anchor_ns - elapsed_ns
            self._height_ns = offset_ns - self._slope * elapsed_ns
            self._jump_ns = 0.0
            self._tie = ticks, float(width_ns)
        self._exchanges.append(_Exchange(ticks, sent_ns))
        self._choose_exchange()

    def _choose_exchange(self) -> None:
        self._best = min(self._exchanges, key=self._late_by_ns, default=None)

    def _judge(self, ticks: int, late_ns: float, received_ns: int) -> None:
        """Detect proofs that the line holds; a step, if there was none for long."""
        if received_ns != self._read_ns:
            if self._run:
                self._run_late_ns = max(self._run_late_ns, self._late_ns)
            self._run += 1
        elif ticks <= self._read_ticks:
            return  # of several that were read together the last one is the least late
        else:
            self._run = self._run or 1
        self._late_ns, self._read_ns, self._read_ticks = late_ns, received_ns, ticks
        slack_ns = max(PROOF_SLACK_NS, self._grain_ns)
        if late_ns <= self._bound_ns() + self._ns_per_tick + slack_ns:
            if self._run > 1:
                self._usual.add(self._run_late_ns, self._run - 1, received_ns)
            self._proven_ns, self._run, self._run_late_ns = received_ns, 0, 0.0
        elif (
            self._run >= STEP_READS
            and received_ns - self._proven_ns > STEP_S * 1e9
            and self.is_late
        ):
            self._step(ticks, received_ns)

    def _step(self, ticks: int, received_ns: int) -> None:
        """Begin anew at the present rate: the counter jumped or stood still."""
        # In the first half second only the first latch was late.
        if self._line_bound_ns < UNKNOWN_NS or self._tie is not None:
            self.steps += 1
            self._stepped_ticks = ticks
        self._restart(ticks, received_ns)

    def _restart(self, ticks: int, received_ns: int) -> None:
        self._forget_exchanges(0.0)
        self._anchor_ticks, self._anchor_ns = ticks, received_ns
        self._floor.reset()
        self._reads = []
        self._height_ns = self._jump_ns = 0.0
        self._fit_ticks = 0
        self._line_bound_ns, self._rate_bound = UNKNOWN_NS, MAX_RATE_ERROR
        self._lines = ()
        self._tie = None
        self._usual = _UsualDelays()
        self._run, self._read_ns, self._proven_ns = 0, 0, received_ns
        self._read_ticks, self._run_late_ns = ticks, 0.0
        self._late_ns = 0.0

    def _lay_line(self, ticks: int) -> None:
        """Adopt the line below the readings so far, if it is due."""
        n_bins = self._floor.n_bins
        self._bins_waited += 1
        if n_bins < FIRST_BINS or (
            n_bins > EACH_BIN and self._bins_waited < LATER_BINS
        ):
            return
        if self._run > LEAST_RUN and n_bins > LEAST_BINS:
            return  # a step, if nothing proves the present line: none lies below both
        self._bins_waited = 0
        line, self._lines = self._floor.lines()
        was_known = self._line_bound_ns < UNKNOWN_NS
        self._line_bound_ns = min(line.bound_ns, UNKNOWN_NS)
        self._enter(ticks, line.slope, line.height_ns)
        self._state_rate_bound(0.0)
        if not was_known and self._line_bound_ns < UNKNOWN_NS:
            self._learn_usual()
        self._choose_exchange()

    def _learn_usual(self) -> None:
        """Judge earlier readings by the line that they gave."""
        reads, self._reads = self._reads, []
        jump_ns, self._jump_ns = self._jump_ns, 0.0
        for ticks, received_ns in reads:
            late_ns = float(received_ns - self.to_ns(ticks))
            self._judge(ticks, late_ns, received_ns)
        self._jump_ns = jump_ns

    def unwrap(self, ticks: NDArray[np.uint32]) -> Integers:
        """Unwrap ticks, (n,) int64, relative to the last ones."""
        unwrapped = ticks.astype(np.int64)
        if self._last is None:
            self._last = int(unwrapped[0])
        unwrapped[1:] -= unwrapped[:-1].copy()
        unwrapped[0] -= self._last % self._wrap
        # Steps of at most half a turn, forwards or back.
        half = self._wrap // 2
        unwrapped += half
        unwrapped %= self._wrap
        unwrapped -= half
        unwrapped[0] += self._last
        return np.cumsum(unwrapped, out=unwrapped)

    def unwrap_one(self, ticks: int) -> int:
        if self._last is None:
            self._last = ticks
        half = self._wrap // 2
        return self._last + (ticks - self._last + half) % self._wrap - half

    # -- mapping -----------------------------------------------------------------

    def to_ns(self, ticks: int) -> int:
        if self._jump_ns:
            return self._on_line_ns(ticks, self._jump_ns * self._share_left(ticks))
        return self._on_line_ns(ticks)

    def _on_line_ns(self, ticks: int, above_ns: float = 0.0) -> int:
        elapsed_ns = (ticks - self._anchor_ticks) * self._ns_per_tick
        correction_ns = self._height_ns + self._slope * elapsed_ns + above_ns
        return self._anchor_ns + round(elapsed_ns + correction_ns)

    def to_ns_array(self, ticks: Integers) -> Integers:
        """Convert unwrapped ticks (n,) to host monotonic times, (n,) int64 [ns]."""
        elapsed = ticks - self._anchor_ticks
        elapsed_ns = elapsed * self._ns_per_tick
        correction_ns = self._height_ns + self._slope * elapsed_ns
        if self._jump_ns and elapsed.min() < self._fit_ticks + self._blend_ticks:
            left = 1.0 - (elapsed - self._fit_ticks) / self._blend_ticks
            correction_ns += self._jump_ns * np.minimum(1.0, np.maximum(0.0, left))
        return self._anchor_ns + np.rint(elapsed_ns + correction_ns).astype(np.int64)

    def _share_left(self, ticks: int) -> float:
        """Return the remaining share of the way to the present line, at a time."""
        passed = ticks - self._anchor_ticks - self._fit_ticks
        return min(1.0, max(0.0, 1.0 - passed / self._blend_ticks))

    def _enter(self, ticks: int, slope: float, height_ns: float) -> None:
        """Change to a new line gradually, so that times never run backwards."""
        before_ns = self.to_ns(ticks)
        self._slope, self._height_ns, self._jump_ns = slope, height_ns, 0.0
        self._fit_ticks = ticks - self._anchor_ticks
        self._jump_ns = float(before_ns - self.to_ns(ticks))
