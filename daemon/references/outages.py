"""Detection of joints that may have lost a turn while not read.

Turns are counted between readings. If none was valid for so long that a joint may have
moved half a turn more than its encoder counts, its turn is in doubt.
"""

from collections import deque
from dataclasses import InitVar, dataclass

import numpy as np

from traverse.arrays import Floats, Indices, Integers
from traverse.drivers.base.values import (
    NOT_READ,
    CountSamples,
)

SPEED_NS = 50_000_000  # speed is taken from so much before and after an outage
SPEED_RISE = 2.0  # a hand may have moved faster in between
LONG_AGO_NS = -(2**62)


@dataclass(frozen=True, slots=True)
class Outage:
    """A joint may have turned too far while not read.

    Attributes:
        place: index in the monitor's ``channels``.
        after_ns: time of the first reading after it.
        has_turned: the speed before or after suffices to lose a turn.
    """

    place: int
    seconds: float
    after_ns: int
    has_turned: bool


@dataclass(eq=False)
class OutageMonitor:
    """Finds such joints of a device.

    Args:
        channels: of the joints, (k,).
        half_wraps_rad: half of the angle after which each count repeats, (k,).
        counts_per_turn: (k,).
        max_speed_rad_s: of the fastest joint.
    """

    channels: Indices
    half_wraps_rad: Floats
    counts_per_turn: Integers
    max_speed_rad_s: InitVar[float]

    def __post_init__(self, max_speed_rad_s: float) -> None:
        self._excluded_ns = self.half_wraps_rad / max_speed_rad_s * 1e9
        self._shortest_ns = int(self._excluded_ns.min())
        # Of the last valid readings: times, numbers, and of which stream all were.
        self._last_ns = np.full(len(self.channels), LONG_AGO_NS)
        self._last_seq = np.zeros(len(self.channels), np.int64)
        self._all_read_ns, self._stream = LONG_AGO_NS, -1
        self._recent: deque[CountSamples] = deque(maxlen=3)  # without an outage

    def add(self, samples: CountSamples) -> list[Outage]:
        if samples.stream != self._stream:
            self._last_seq[:] = -2  # some may be missing between two streams
        until_ns = int(samples.sample_time_ns[-1])
        is_read = not (samples.status & NOT_READ).any()
        outages: list[Outage] = []
        if is_read and (
            until_ns - self._all_read_ns < self._shortest_ns
            or self._is_next(samples.seq)
        ):
            self._last_ns.fill(until_ns)
            self._last_seq.fill(samples.seq[-1])
            self._all_read_ns = until_ns
        else:
            places = range(len(self.channels))
            candidates = [self._outage(samples, place) for place in places]
            outages = [outage for outage in candidates if outage is not None]
            self._all_read_ns = int(self._last_ns.min())
        if is_read:
            self._recent.append(samples)
        self._stream = samples.stream
        return outages

    def _is_next(self, seq: Integers) -> bool:
        """Return whether no sample is missing before or within a block."""
        follows = (self._last_seq == seq[0] - 1).all()
        return bool(follows) and int(seq[-1] - seq[0]) == len(seq) - 1

    def _outage(self, samples: CountSamples, place: int) -> Outage | None:
        times_ns, _, seq = self._readings(samples, place)
        if not len(times_ns):
            return None
        before_ns, before_seq = int(self._last_ns[place]), self._last_seq[place]
        self._last_ns[place], self._last_seq[place] = times_ns[-1], seq[-1]
        if before_ns == LONG_AGO_NS:
            return None
        # A device that is silent while nothing moves loses nothing.
        is_missing = np.diff(seq, prepend=before_seq) > 1
        gaps_ns = np.where(is_missing, np.diff(times_ns, prepend=before_ns), 0)
        gap_ns = int(gaps_ns.max())
        if gap_ns < self._excluded_ns[place]:
            return None
        after_ns = int(times_ns[gaps_ns.argmax()])
        parts = [self._readings(block, place) for block in (*self._recent, samples)]
        times_ns, counts, _ = map(np.concatenate, zip(*parts, strict=True))
        speeds = [
            self._speed_rad_s(times_ns[rows], counts[rows], place)
            for rows in (
                (times_ns >= after_ns - gap_ns - SPEED_NS) & (times_ns < after_ns),
                (times_ns >= after_ns) & (times_ns < after_ns + SPEED_NS),
            )
        ]
        fastest_rad_s = max((s for s in speeds if s is not None), default=np.inf)
        turned_rad = SPEED_RISE * fastest_rad_s * gap_ns * 1e-9
        has_turned = bool(turned_rad >= self.half_wraps_rad[place])
        return Outage(place, gap_ns * 1e-9, after_ns, has_turned)

    def _readings(
        self, block: CountSamples, place: int
    ) -> tuple[Integers, Integers, Integers]:
        """Return times, counts and numbers of one joint's valid readings."""
        channel = self.channels[place]
        times_ns = block.sample_time_ns
        if block.skew_ns is not None:
            times_ns = times_ns + block.skew_ns[:, channel]
        rows = (block.status[:, channel] & NOT_READ) == 0
        counts = block.counts[rows, channel].astype(np.int64)
        return times_ns[rows], counts, block.seq[rows]

    def _speed_rad_s(
        self, times_ns: Integers, counts: Integers, place: int
    ) -> float | None:
        """Return the mean speed over readings closer than half a turn, or None."""
        if len(times_ns) < 2 or times_ns[-1] <= times_ns[0]:
            return None
        turn = int(self.counts_per_turn[place])
        step = (int(counts[-1] - counts[0]) + turn // 2) % turn - turn // 2
        elapsed_s = int(times_ns[-1] - times_ns[0]) * 1e-9
        return abs(step) / turn * 2.0 * np.pi / elapsed_s
