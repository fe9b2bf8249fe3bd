"""Counts that go on from another place: a zero that was set, counts that were lost.

Nothing but the jump shows it. Between two readings it is a way that no hand leads a
joint: the speeds before and after are alike, and the way is not theirs; or no joint is
that quick. A stop, a knock and a wrist that flips past a singular posture change the
speed, a spoilt reading goes back with the next one. What is led more abruptly than by a
hand, as by a script, shows it in the ways before and after.
"""

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from traverse.arrays import Floats, Indices, Integers
from traverse.daemon.references.outages import LONG_AGO_NS
from traverse.drivers.base.values import (
    NOT_READ,
    STATUS_TIME_UNCERTAIN,
    CountSamples,
)
from traverse.drivers.polling.channel import HAND_RAD_S2, START_RAD_S3

KNOCK_RAD = 5e-3  # that an arm swings between two readings
ALIKE_RAD_S = 1.0  # speeds before and after, beside what a hand changes meanwhile
SLACK_COUNTS = 4
GAP_NS = 250_000_000  # after a longer one a joint may be anywhere
ABRUPT = 4.0  # of what is no hand's motion just before and after
KEPT_ROWS = 5
ARRIVALS = 32  # from which the delay of blocks is known


def least_jump_rad(
    period_s: float,
    count_rad: float,
    speed_rad_s: float = 0.0,
    unknown_s: tuple[float, float] = (0.0, 0.0),
) -> float:
    """Return the smallest jump that shows, of readings in equal intervals."""
    late_s, off_s = unknown_s
    led_rad = float(_led_rad(period_s + late_s)) + 2.0 * abs(speed_rad_s) * off_s
    return KNOCK_RAD + led_rad + 2.0 * SLACK_COUNTS * count_rad


def _led_rad(seconds: ArrayLike) -> Floats:
    """Return how far a hand may lead a joint off its motion, in as long."""
    by_force = HAND_RAD_S2 * np.square(seconds)
    return np.minimum(by_force, START_RAD_S3 * np.power(seconds, 3))


@dataclass(frozen=True, slots=True)
class Jump:
    """A count has jumped after its reading of a time.

    Attributes:
        place: index in the monitor's ``channels``.
    """

    place: int
    by_rad: float
    since_ns: int


class JumpMonitor:
    """Finds joints of a device whose counts have jumped.

    Args:
        channels: of the joints, (k,).
        wraps_counts: where each count returns to 0, (k,).
        count_rad: (k,).
        jitter_ns: error of the readings' times, where they state none.
        max_speed_rad_s: of the fastest joint.

    Attributes:
        unknown_s: for how long a device's counter may have stood, and by how much two
            of its latest times may be off.
    """

    def __init__(
        self,
        channels: Indices,
        wraps_counts: Integers,
        count_rad: Floats,
        jitter_ns: int,
        max_speed_rad_s: float,
    ) -> None:
        self._channels, self._wraps = channels, wraps_counts
        self._count_rad, self._max_speed_rad_s = count_rad, max_speed_rad_s
        self._jitter_ns, self._last = jitter_ns, (0, 0)  # time and ticks
        self.unknown_s = 0.0, 0.0
        self._delays_ns: deque[int] = deque(maxlen=ARRIVALS)
        shape = KEPT_ROWS, len(channels)
        self._counts = np.zeros(shape, np.int64)
        self._times_ns = np.full(shape, LONG_AGO_NS)

    def add(self, samples: CountSamples) -> list[Jump]:
        """Follow readings; a jump shows with the second one after it."""
        status = samples.status[:, self._channels]
        late_s, off_s = 1e-9 * self._late_ns(samples), 2e-9 * self._bound_ns(samples)
        self.unknown_s = late_s, off_s + late_s
        if (status & STATUS_TIME_UNCERTAIN).any():
            self._times_ns[:] = LONG_AGO_NS
            return []
        times_ns = np.repeat(samples.sample_time_ns[:, None], len(self._channels), 1)
        if samples.skew_ns is not None:
            times_ns += samples.skew_ns[:, self._channels]
        counts = samples.counts[:, self._channels].astype(np.int64)
        is_read = (status & NOT_READ) == 0
        places = np.arange(len(self._channels))
        groups = [places] if is_read.all() else np.split(places, len(places))
        jumps: list[Jump] = []
        for group in groups:
            cells = np.ix_(np.flatnonzero(is_read[:, group[0]]), group)
            jumps += self._follow(group, times_ns[cells], counts[cells])
        return jumps

    def _late_ns(self, samples: CountSamples) -> int:
        """Return for how long the device's counter may have stood unseen.

        Blocks are later than before by as much. Polled readings have the host's times.
        """
        if samples.device_ticks[-1] == samples.sample_time_ns[-1]:
            return 0
        delay_ns = samples.received_ns - int(samples.sample_time_ns[-1])
        self._delays_ns.append(delay_ns)
        return delay_ns - min(self._delays_ns)

    def _bound_ns(self, samples: CountSamples) -> float:
        """Return by how much times of readings may be off against each other.

        By their device's own clock it is one tick, however well that clock is known.
        """
        time_ns, ticks = int(samples.sample_time_ns[-1]), int(samples.device_ticks[-1])
        passed_ns, passed = time_ns - self._last[0], ticks - self._last[1]
        self._last = time_ns, ticks
        if 0 < passed < passed_ns:
            return passed_ns / passed
        bounds = samples.skew_bound_ns
        if bounds is not None and bounds.any():
            return int(bounds.max())
        return samples.time_bound_ns or self._jitter_ns

    def _follow(
        self,
        places: Indices,
        times_ns: Integers,
        counts: Integers,
    ) -> list[Jump]:
        """Continue with readings (n, m) of some joints."""
        times_ns = np.vstack([self._times_ns[:, places], times_ns])
        counts = np.vstack([self._counts[:, places], counts])
        self._times_ns[:, places] = times_ns[-KEPT_ROWS:]
        self._counts[:, places] = counts[-KEPT_ROWS:]
        wraps, count_rad = self._wraps[places], self._count_rad[places]
        steps = (np.diff(counts, axis=0) + wraps // 2) % wraps - wraps // 2
        ways_rad, passed_ns = steps * count_rad, np.diff(times_ns, axis=0)
        shortest_ns = passed_ns.min()
        if shortest_ns > 0:  # mostly: no way, nor one that others suggest, is so long
            most_alike = 1.0 + passed_ns.max() / shortest_ns
            if np.abs(ways_rad).max() * most_alike < KNOCK_RAD:
                return []
        is_near = (passed_ns > 0) & (passed_ns <= GAP_NS)
        passed_s = np.where(is_near, passed_ns, GAP_NS) * 1e-9
        speeds = ways_rad / passed_s
        late_s, off_s = self.unknown_s
        # Of each way and the one before it.
        pair_s = (passed_s[1:] + passed_s[:-1]) / 2.0
        ratio = 1.0 + passed_s[1:] / passed_s[:-1]
        slack_rad = KNOCK_RAD + SLACK_COUNTS * count_rad * ratio
        slack_rad += _led_rad(np.maximum(passed_s[1:], passed_s[:-1]) + late_s)
        slack_rad += np.abs(speeds[:-1]) * off_s * ratio
        abrupt_rad_s = np.abs(np.diff(speeds, axis=0)) - HAND_RAD_S2 * pair_s
        abrupt_rad_s = np.maximum(abrupt_rad_s, 0.0)
        are_near = is_near[1:] & is_near[:-1]
        # Of each way between two and two others.
        before, after, way_s = speeds[1:-3], speeds[3:-1], passed_s[2:-2]
        slack_rad = slack_rad[1:-2]
        slack_rad += ABRUPT * (abrupt_rad_s[:-3] + abrupt_rad_s[3:]) * way_s
        ways_rad = ways_rad[2:-2]
        low_rad = np.minimum(before, after) * way_s - slack_rad
        high_rad = np.maximum(before, after) * way_s + slack_rad
        hand_rad_s = ALIKE_RAD_S + HAND_RAD_S2 * (pair_s[1:-2] + pair_s[2:-1] + late_s)
        hand_rad_s += np.abs(before) * off_s / passed_s[3:-1]
        has_jumped = np.abs(after - before) <= hand_rad_s
        has_jumped &= (ways_rad < low_rad) | (ways_rad > high_rad)
        most_rad_s = self._max_speed_rad_s
        most_rad = KNOCK_RAD + most_rad_s * (way_s + late_s)
        is_too_quick = np.abs(ways_rad) > most_rad  # however abruptly it is led
        beside_rad_s = np.maximum(np.abs(before), np.abs(after))
        is_too_quick &= beside_rad_s < most_rad_s
        has_jumped |= is_too_quick
        # Nor may a hand lead it half way round meanwhile, which looks like the other.
        led_rad = (beside_rad_s + HAND_RAD_S2 * way_s) * way_s
        has_jumped &= led_rad < wraps * count_rad / 2.0
        has_jumped &= are_near[:-3] & is_near[2:-2] & are_near[3:]
        jumps = []
        for row, column in np.argwhere(has_jumped).tolist():
            by_rad = ways_rad[row, column] - before[row, column] * way_s[row, column]
            since_ns = int(times_ns[row + 2, column])
            jumps.append(Jump(int(places[column]), float(by_rad), since_ns))
        return jumps
