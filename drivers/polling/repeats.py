"""Single readings that repeat the last count while their joint moves on.

A board whose read of an encoder fails now and then, and that cannot say so, hands on
the count of before. Readings then step v, 0, 2 v, v: nothing in the count says that it
is old, but the next one is where the joint would have been.

Strategy: a run of equal counts is compared with the motion that the three readings
before and the three after it agree on, a parabola through all six. It is a repeat if
the joint should have left that count by some steps of the encoder, and by far more than
the six readings leave the parabola, and than readings in such a motion usually leave
theirs. A joint that stops, or is held by friction, does so between two readings, and
they show it; noise and rounding that would bring a reading exactly to the count before
show themselves in the others. Steps are those from one reading to the next: their
times, which a host may know badly, matter only where a reading may have come too soon.
"""

import numpy as np

from traverse.arrays import Floats, Indices, Integers
from traverse.drivers.base.values import NOT_READ, CountSamples, RepeatedCount
from traverse.drivers.polling.channel import HAND_RAD_S2

KEPT_ROWS = 300
BESIDE = 3  # readings before a run, and after it
MOST_REPEATS, LONGEST_NS = 100, 200_000_000  # of one run; a longer one is a freeze
LEAST_STEPS = 4  # of the encoder, from one reading to the next
LEAST_SHARE = 6.0  # of what the readings beside leave the parabola
LEAST_NOISE = 10.0  # standard deviations of readings in such a motion
LIKE = 0.5, 1.75  # shares of a step that are such a motion
LIKE_ROWS = 10
CLEAR_STEPS, CLEAR_SHARE = 20, 15.0  # of one that is no chance, by itself
SOON_SHARE = 0.5  # of the time between two readings
NEVER = 2**62
# Of third differences of noise: its standard deviation by their upper quartile.
QUARTILE_STDS = 1.15 * 20.0**0.5


class RepeatDetector:
    """Finds repeated counts of one device.

    Args:
        device: its id.
        channels: of the joints, (k,).
        wraps_counts: where each count returns to 0, (k,).
        count_rad: (k,).
    """

    def __init__(
        self,
        device: str,
        channels: Indices,
        wraps_counts: Integers,
        count_rad: Floats,
    ) -> None:
        self._device = device
        self._channels, self._wraps = channels, wraps_counts
        self._count_rad = count_rad
        # What the encoder really resolves: a board may print tenths of a degree.
        self._least_steps = np.full(len(channels), NEVER)
        self._stream, self._n_latest = -1, 0
        self._forget()

    def _forget(self) -> None:
        shape = 0, len(self._channels)
        self._seq = np.zeros(0, np.int64)
        self._times_ns = np.zeros(shape, np.int64)
        self._counts = np.zeros(shape, np.int64)
        self._is_read = np.zeros(shape, np.bool_)
        self._unjudged: list[tuple[int, int]] = []  # seq of a new reading; place

    def add(self, samples: CountSamples) -> list[RepeatedCount]:
        """Follow readings; a repeat shows with the third new reading after it."""
        if samples.stream != self._stream:
            self._stream = samples.stream
            self._forget()
        self._append(samples)
        n_latest = self._n_latest = len(samples.seq)
        n_before = len(self._seq) - n_latest
        # With the two last steps before this block.
        begin = max(n_before - 3, 0)
        steps = np.diff(self._counts[begin:], axis=0)
        sizes = np.abs(steps)
        is_step = (sizes > 0) & self._is_read[begin + 1 :] & self._is_read[begin:-1]
        least = np.where(is_step, sizes, NEVER).min(axis=0, initial=NEVER)
        self._least_steps = np.minimum(self._least_steps, least)
        before, still, after = steps[:-2], steps[1:-1], steps[2:]
        has_caught_up = (still == 0) & (sizes[2:] >= 2 * LEAST_STEPS)
        has_caught_up &= (before == 0) | (before * np.sign(after) > 0)
        for row, place in np.argwhere(has_caught_up).tolist():
            self._unjudged.append((int(self._seq[begin + row + 3]), place))
        return self._judge() if self._unjudged else []

    def led_ns(self, place: int, period_ns: int) -> int:
        """Return for how much of the latest block a repeat would show.

        Args:
            place: of the joint in ``channels``.
            period_ns: of the readings in which it would, if they are more than these.
        """
        rows = slice(-1 - self._n_latest, None)
        steps = np.abs(np.diff(self._counts[rows, place]))
        passed_ns = np.diff(self._times_ns[rows, place])
        is_read = self._is_read[rows, place]
        if not len(steps):
            return 0
        is_next = is_read[1:] & is_read[:-1] & (np.diff(self._seq[rows]) == 1)
        share = min(1.0, period_ns / max(float(np.median(passed_ns)), 1.0))
        least = self._least_counts(place, float(steps[-1]))
        shows = is_next & (steps * share >= least)
        return int(passed_ns[shows].sum())

    def _append(self, samples: CountSamples) -> None:
        raw = samples.counts[:, self._channels].astype(np.int64)
        times_ns = np.repeat(samples.sample_time_ns[:, None], raw.shape[1], axis=1)
        if samples.skew_ns is not None:
            times_ns += samples.skew_ns[:, self._channels]
        last = self._counts[-1:] if len(self._counts) else raw[:1]
        half = self._wraps // 2
        # What is kept is unwrapped: the count of a wrap later is another one.
        steps = np.diff(raw, axis=0, prepend=last % self._wraps)
        steps = (steps + half) % self._wraps - half
        counts = last + np.cumsum(steps, axis=0)
        is_read = (samples.status[:, self._channels] & NOT_READ) == 0
        # Those of before, and the whole block, however long it is.
        kept = slice(-KEPT_ROWS, None)
        self._seq = np.concatenate([self._seq[kept], samples.seq])
        self._times_ns = np.concatenate([self._times_ns[kept], times_ns])
        self._counts = np.concatenate([self._counts[kept], counts])
        self._is_read = np.concatenate([self._is_read[kept], is_read])

    def _judge(self) -> list[RepeatedCount]:
        """Judge runs of equal counts after which enough readings have arrived."""
        repeats, waiting = [], []
        for seq, place in self._unjudged:
            row = int(np.searchsorted(self._seq, seq))
            if row + BESIDE > len(self._seq):
                waiting.append((seq, place))
            elif repeat := self._repeat(row, place):
                repeats.append(repeat)
        self._unjudged = waiting
        return repeats

    def _repeat(self, after: int, place: int) -> RepeatedCount | None:
        """Judge the equal counts before the row of a new one."""
        counts = self._counts[:, place]
        before = after - 1
        while before > after - 2 - MOST_REPEATS and (
            before > 0 and counts[before - 1] == counts[before]
        ):
            before -= 1
        rows = np.r_[before - BESIDE + 1 : before + 1, after : after + BESIDE]
        if rows[0] < 0:
            return None
        senses = np.sign(np.diff(counts[rows])).tolist()
        if len({*senses}) > 1:  # mostly: noise of a joint that rests
            return None
        times_ns, passed = self._times_ns[:, place], rows - before
        if times_ns[after] - times_ns[before] > LONGEST_NS or not self._are_regular(
            int(rows[0]), int(rows[-1]), place
        ):
            return None
        beside = (counts[rows] - counts[before]).astype(np.float64)
        powers = np.vander(passed.astype(np.float64), 3)
        motion = np.linalg.lstsq(powers, beside, rcond=None)[0]
        off_counts = abs(float(motion.sum()))  # one reading after the last new one
        left = float(np.abs(beside - powers @ motion).max())
        least = self._least_counts(place, off_counts)
        if off_counts < max(least, LEAST_SHARE * left):
            return None
        count_rad, period_s = (
            self._count_rad[place],
            1e-9 * float(times_ns[after] - times_ns[before]) / (after - before),
        )
        is_clear = (
            off_counts >= CLEAR_STEPS * self._least_steps[place]
            and off_counts >= CLEAR_SHARE * left
            and off_counts * count_rad >= HAND_RAD_S2 * period_s**2
        )
        return RepeatedCount(
            self._device,
            int(self._channels[place]),
            after - before - 1,
            float(motion.sum() * count_rad),
            int(times_ns[before]),
            int(times_ns[after]),
            bool(is_clear),
            round(1e9 * period_s),
        )

    def _are_regular(self, first: int, last: int, place: int) -> bool:
        """Return whether nothing is missing, and no reading came too soon."""
        rows = slice(first, last + 1)
        passed_ns = np.diff(self._times_ns[rows, place])
        return bool(
            self._is_read[rows, place].all()
            and self._seq[last] - self._seq[first] == last - first
            and passed_ns.min() >= SOON_SHARE * passed_ns.mean()
        )

    def _least_counts(self, place: int, step: float) -> float:
        """Return which repeated step shows, in motions by about such a step."""
        counts, is_read = self._counts[:, place], self._is_read[:, place]
        steps = np.diff(counts)
        sizes = np.abs(steps)
        is_like = (sizes >= LIKE[0] * step) & (sizes <= LIKE[1] * step)
        is_like &= is_read[1:] & is_read[:-1] & (np.diff(self._seq) == 1)
        three = is_like[2:] & is_like[1:-1] & is_like[:-2]
        if three.sum() < LIKE_ROWS:
            return np.inf
        thirds = np.abs(np.diff(steps, n=2)[three])
        noise = float(np.percentile(thirds, 75)) / QUARTILE_STDS
        least = LEAST_STEPS * int(self._least_steps[place])
        return max(float(least), LEAST_NOISE * float(noise))
