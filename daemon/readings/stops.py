"""Joints that stop between two readings, without braking, while others move on.

This is seen in the readings themselves: interpolation at the instants of samples would
spread a stop over two of them.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from traverse.arrays import Floats, Indices, Integers

GAP_NS = 400_000_000  # longer: what was before says nothing
STEP_NS = 1_000_000  # between readings that are looked at, where they are quicker
SPEED_S = 0.01  # over which a speed is measured, at least
SPEED_ROWS, STILL_ROWS = 2, 5  # fewest steps with motion, and without
LONG_STEP_S = 0.015  # of which one is enough, after another
SHARE_BEFORE = 0.25  # of that speed, in the step before: else it was knocked
STILL_S = 0.05
BRAKING_RAD_S2 = 7.5  # a hand brakes by less while it leads other joints on
TREMOR_RAD_S = 2e-3  # a joint that a hand holds moves at least so fast
TREMOR_COUNTS = 3  # of such a motion that a living encoder shows
MOVED_RAD = 2e-3  # of another joint, meanwhile
LED_RAD_S2 = 20.0  # as it may be led on quicker


@dataclass(frozen=True, slots=True)
class Series:
    """Latest readings of some joints, in which none is missing.

    Attributes:
        joints: of the arm, (k,).
        times_s: (m, k), and how far each may be off, ``bounds_s``.
        counts: (m, k), with fractions.
    """

    joints: Indices
    times_s: Floats
    bounds_s: Floats
    counts: Floats


@dataclass(frozen=True, slots=True)
class Window:
    """Latest readings of all joints.

    Attributes:
        count_rad: (n_joints,), always positive.
    """

    series: Sequence[Series]
    count_rad: Floats

    def places_counts(self, at_s: float) -> Floats:
        """Return the counts of all joints at some time, (n_joints,)."""
        places = np.zeros(len(self.count_rad))
        for series in self.series:
            for column, joint in enumerate(series.joints.tolist()):
                times_s, counts = series.times_s[:, column], series.counts[:, column]
                places[joint] = np.interp(at_s, times_s, counts)
        return places

    def speeds_rad_s(self, begin_s: float, end_s: float) -> Floats:
        """Return mean speeds (n_joints,) from one time to another."""
        passed = self.places_counts(end_s) - self.places_counts(begin_s)
        return np.asarray(passed * self.count_rad / (end_s - begin_s))


def thinned(times_ns: Integers, counts: Floats) -> tuple[Integers, Floats]:
    """Return the last reading of a block, and earlier ones at least `STEP_NS` apart."""
    passed_ns = max(int(times_ns[-1] - times_ns[0]), 1)
    step = max(STEP_NS * (len(times_ns) - 1) // passed_ns, 1)
    kept = np.arange(len(times_ns) - 1, -1, -step)[::-1]
    return times_ns[kept], counts[kept]


def stopped_joints(window: Window) -> list[tuple[int, float]]:
    """Return joints, from 0, that stopped without braking while others moved on.

    Beside each: the time of the last reading before its count is constant. That the
    whole arm rests meanwhile changes nothing.
    """
    stopped = []
    for series in window.series:
        latest = series.counts[-STILL_ROWS - 1 :]
        may_be = (latest == latest[-1]).all(axis=0)
        if len(latest) <= STILL_ROWS or not may_be.any():
            continue
        has_moved = series.counts[1:] != series.counts[:-1]
        for column in np.flatnonzero(may_be & has_moved.any(axis=0)).tolist():
            row = 1 + int(np.flatnonzero(has_moved[:, column])[-1])
            if _has_stopped(window, series, column, row):
                before_s = float(series.times_s[row - 1, column])
                stopped.append((int(series.joints[column]), before_s))
    return stopped


def _has_stopped(window: Window, series: Series, column: int, row: int) -> bool:
    """Return whether a joint that is still from a row on has stopped so."""
    joint = int(series.joints[column])
    count_rad = float(window.count_rad[joint])
    times_s, counts = series.times_s[:, column], series.counts[:, column]
    still_s = float(times_s[-1] - times_s[row])
    if still_s < max(STILL_S, TREMOR_COUNTS * count_rad / TREMOR_RAD_S):
        return False
    begin = _motion_begin(times_s, counts, row)
    return (
        begin is not None
        and not _may_have_braked(series, column, (begin, row), count_rad)
        and _others_go_on(window, times_s, (begin, row))
    )


def _motion_begin(times_s: Floats, counts: Floats, row: int) -> int | None:
    """Return since when a joint moves before its last step with motion, to a row.

    None if it did not move one way: a spoilt count goes there and back, and a joint
    that is knocked rests before. Times and counts are (m,).
    """
    moving = row - 1
    begin = int(np.searchsorted(times_s, times_s[moving] - SPEED_S, side="right")) - 1
    if moving > 0 and times_s[moving] - times_s[moving - 1] >= LONG_STEP_S:
        begin = min(begin, moving - 1)
        first = begin - 1
    else:
        begin = first = min(begin, moving - SPEED_ROWS)
    if first < 0:
        return None
    senses = np.sign(np.diff(counts[first : row + 1]))
    if senses.min() * senses.max() < 0:
        return None
    if first < begin:
        speed = (counts[moving] - counts[begin]) / (times_s[moving] - times_s[begin])
        earlier = (counts[begin] - counts[first]) / (times_s[begin] - times_s[first])
        if abs(earlier) <= SHARE_BEFORE * abs(speed):
            return None
    return begin


def _may_have_braked(
    series: Series, column: int, rows: tuple[int, int], count_rad: float
) -> bool:
    """Return whether a joint may have braked that moves and is still from rows on.

    Strategy: with v the mean speed over a time h before the last step with motion, d
    the way within that step, and t its duration, whoever brakes with a at most cannot
    have come to rest if

        d > a t^2 / 2    or    v > a h / 2 + sqrt(2 a d)    or    v > a (h / 2 + t)

    In the first case it was too quick to stop within the step, in the second the way
    is too short to stop from v; the third, where one of these holds for any d, needs no
    count of d. Below a (h + t) / 2 nothing is said: a knock moves a joint as far.

    Each instant has its bound, and each count is rounded: a joint whose count is
    constant may have gone on by one, for sqrt(2 / a) of its root.
    """
    begin, row = rows
    moving = row - 1
    times_s, bounds_s = series.times_s[:, column], series.bounds_s[:, column]
    counts, braking = series.counts[:, column], BRAKING_RAD_S2
    before_s = times_s[moving] - times_s[begin] + bounds_s[moving] + bounds_s[begin]
    last_s = times_s[row] - times_s[moving] + bounds_s[row] + bounds_s[moving]
    last_s += np.sqrt(2.0 * count_rad / braking)
    way_rad = abs(counts[moving] - counts[begin]) * count_rad
    last_rad = abs(counts[row] - counts[moving]) * count_rad
    speed_rad_s = (way_rad - 2.0 * count_rad) / before_s
    if speed_rad_s <= braking * (before_s + last_s) / 2.0:
        return True
    way_braked_rad_s = np.sqrt(2.0 * braking * (last_rad + 2.0 * count_rad))
    longest_braked_rad_s = min(way_braked_rad_s, braking * last_s)
    is_too_quick = last_rad - count_rad > braking * last_s**2 / 2.0
    is_too_short = speed_rad_s > braking * before_s / 2.0 + longest_braked_rad_s
    return not (is_too_quick or is_too_short)


def _others_go_on(window: Window, times_s: Floats, rows: tuple[int, int]) -> bool:
    """Return whether another joint moves on as before one stopped.

    ``times_s`` (m,) are of the joint that moves and is still from rows on.
    """
    begin, row = rows
    end = min(int(np.searchsorted(times_s, times_s[row] + STILL_S)), len(times_s) - 1)
    before_rad_s = window.speeds_rad_s(float(times_s[begin]), float(times_s[row - 1]))
    after_rad_s = window.speeds_rad_s(float(times_s[row]), float(times_s[end]))
    passed = window.places_counts(0.0) - window.places_counts(float(times_s[row]))
    shares = after_rad_s * before_rad_s / np.maximum(before_rad_s**2, 1e-12)
    between_s = (times_s[row] + times_s[end] - times_s[begin] - times_s[row - 1]) / 2.0
    gained_rad_s = np.abs(after_rad_s) - np.abs(before_rad_s)
    goes_on = (shares > 0.5) & (
        (shares < 2.0) | (gained_rad_s < LED_RAD_S2 * between_s)
    )
    return bool((goes_on & (np.abs(passed) * window.count_rad > MOVED_RAD)).any())
