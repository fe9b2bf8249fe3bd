"""Linear interpolation of one encoder's readings at other instants.

Between readings at t_0 and t_1 = t_0 + h the count at t_0 + s is taken as

    x = x_0 + (x_1 - x_0) s / h

What that leaves out is f'' s (h - s) / 2 at some acceleration f'' met between them, at
most f'' h^2 / 8 (the error of linear interpolation, as in any book on numerical
analysis; Atkinson, "An Introduction to Numerical Analysis", section 3.1). f'' is taken
from second divided differences at both ends, less what rounding to whole counts alone
can make of one. A joint that begins to move between the readings leaves out twice to
five times as much: it had all of its acceleration in a part of h. Twice that error is
the first bound of a count. The second is what the
instants themselves leave open: the speed times how far both may be off, e_0 and e_1,

    |f'| (e_0 (h - s) + e_1 s) / h
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from traverse.arrays import Floats, Integers
from traverse.drivers.base.values import (
    STATUS_INTERPOLATED,
    STATUS_LATE,
    STATUS_MISSING,
    are_valid,
)


class EncoderReadings(NamedTuple):
    """Successive readings of one encoder (n,), or of all of a device (n, k).

    Attributes:
        times_ns: host monotonic, strictly increasing.
        status: bits ``STATUS_*``.
        numbers: (n,) consecutive where none was lost.
        bounds_ns: error of the times against those of other joints.
    """

    times_ns: Integers
    counts: Integers
    status: NDArray[np.uint8]
    numbers: Integers
    bounds_ns: Integers


@dataclass(frozen=True, slots=True, eq=False)
class Interpolated:
    """Counts of one encoder at m instants, (m,), or of k encoders, (m, k).

    Attributes:
        counts: over all turns, rounded; ``fractions`` holds the remainder.
        status: bits of all readings used, with ``STATUS_INTERPOLATED``;
            ``STATUS_LATE`` where the last reading stands in for a later one;
            ``STATUS_MISSING`` where readings around the instant are lacking.
        error_bounds_counts: (m, 2) or (m, k, 2) error by motion (greatest), and by
            the instants (of either sign).
    """

    counts: Integers
    fractions: Floats
    status: NDArray[np.uint8]
    error_bounds_counts: Floats


@dataclass(frozen=True, slots=True)
class InterpolationLimits:
    """Bounds on readings that are interpolated.

    Attributes:
        max_gap_ns: a longer interval means lost readings.
        late_ns: greatest age of a last reading that may stand in.
    """

    max_gap_ns: int
    late_ns: int


def interpolate(
    readings: EncoderReadings, instants_ns: Integers, limits: InterpolationLimits
) -> Interpolated:
    valid = np.flatnonzero(are_valid(readings.status))
    if not len(valid):  # else the last valid count
        return _last_known(readings, len(instants_ns))
    t, x = readings.times_ns[valid], readings.counts[valid]
    numbers, status = readings.numbers[valid], readings.status[valid]
    last = len(t) - 1
    after = np.searchsorted(t, instants_ns, side="left")
    held = after > last
    right = np.minimum(after, last)
    exact = t[right] == instants_ns
    early = (after == 0) & ~exact
    left = np.where(exact | held | early, right, right - 1)
    span_ns = t[right] - t[left]
    run_ns = instants_ns - t[left]
    rise = (x[right] - x[left]) * (run_ns / np.maximum(span_ns, 1))
    whole_counts = np.rint(rise)
    flags = status[left] | status[right]
    gaps = (numbers[right] - numbers[left] > 1) | (span_ns > limits.max_gap_ns) | early
    for row in np.flatnonzero(gaps & (left < right)).tolist():
        between = slice(valid[left[row]], valid[right[row]])
        flags[row] |= np.bitwise_or.reduce(readings.status[between])
    if held.any():
        trailing = readings.status[valid[-1] :]
        flags[held] |= np.bitwise_or.reduce(trailing)
        gone = held & ((run_ns > limits.late_ns) | (len(trailing) > 1))
        flags[held & ~gone] |= STATUS_LATE
        gaps |= gone
    flags[gaps] |= STATUS_MISSING
    flags[left < right] |= STATUS_INTERPOLATED
    return Interpolated(
        x[left] + whole_counts.astype(np.int64),
        rise - whole_counts,
        flags,
        _error_bounds(t, x, (left, right), run_ns, readings.bounds_ns[valid]),
    )


def _last_known(readings: EncoderReadings, n: int) -> Interpolated:
    status = np.bitwise_or.reduce(readings.status) | STATUS_MISSING
    return exact(np.full(n, readings.counts[-1]), np.full(n, status, np.uint8))


def exact(counts: Integers, status: NDArray[np.uint8]) -> Interpolated:
    """Wrap counts that were read at the instants themselves."""
    no_bounds = np.zeros((*counts.shape, 2))
    return Interpolated(counts, np.zeros(counts.shape), status, no_bounds)


_COLUMNS = tuple(field.name for field in fields(Interpolated))


def combined(parts: Sequence[Interpolated], how: Callable[..., Any]) -> Interpolated:
    """Join joints as columns; ``how`` is `np.stack` or `np.concatenate`."""
    columns = ([getattr(part, name) for part in parts] for name in _COLUMNS)
    return Interpolated(*(how(column, axis=1) for column in columns))


def _error_bounds(
    t: Integers,
    x: Integers,
    ends: tuple[Integers, Integers],
    run_ns: Integers,
    bounds_ns: Integers,
) -> Floats:
    """Compute error bounds of interpolated counts, (m, 2); 0 where none was."""
    if len(t) < 2:
        return np.zeros((len(run_ns), 2))
    left, right = ends
    span_ns = np.diff(t)
    speeds = np.diff(x) / span_ns
    second_differences = np.zeros(len(t))
    reach_ns = span_ns[1:] + span_ns[:-1]
    rounding = 2.0 * (1.0 / span_ns[1:] + 1.0 / span_ns[:-1]) / reach_ns
    second_differences[1:-1] = np.maximum(
        2.0 * np.abs(np.diff(speeds)) / reach_ns - rounding, 0.0
    )
    speed = np.abs(speeds[np.minimum(left, len(speeds) - 1)])
    between = (
        np.maximum(second_differences[left], second_differences[right])
        * run_ns
        * (t[right] - t[left] - run_ns)
    )
    # Beyond the last reading the joint may have continued its motion.
    beyond = (
        speed * run_ns + second_differences[-2] * run_ns.astype(np.float64) ** 2 / 2.0
    )
    inside = left < right
    outside = (run_ns > 0) & ~inside
    motion = np.where(inside, between, np.where(outside, beyond, 0.0))
    # Errors of both times move the line between them by their shares.
    share = run_ns / np.maximum(t[right] - t[left], 1)
    off_ns = bounds_ns[left] + (bounds_ns[right] - bounds_ns[left]) * share
    instants = np.where(inside | outside, speed * off_ns, 0.0)
    return np.stack([motion, instants], axis=1)
