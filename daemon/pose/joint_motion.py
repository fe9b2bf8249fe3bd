"""Joint speeds and directions of approach.

A speed is the mean since the latest sample at least a millisecond older: on fast
streams the noise of two neighbours over their short time would exceed the speed.

The direction of approach has a hysteresis against encoder noise. The reading carries a
pointer along within a band of play; the direction is that in which the pointer was last
pushed, so that a joint must return by the whole band to reverse it.

Both continue from block to block, independent of how the stream is cut. After a gap, a
time that runs backwards or an invalid count, both are unknown, 0, until the next
motion.
"""

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from traverse.arrays import Booleans, Floats, Integers

SPEED_NS = 1_000_000
GAP_NS = 250_000_000  # the slowest stream has a sample every 100 ms
KEPT_NS = 1_000_000_000  # an edge that had to be repeated is no older


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """Motion at n_samples samples.

    Attributes:
        speeds_rad_s: 0 where unknown, (n_samples, n_joints).
        are_speeds_known: (n_samples,).
        approaches: -1 or +1, 0 where unknown, (n_samples, n_joints).
    """

    speeds_rad_s: Floats
    are_speeds_known: Booleans
    approaches: Floats

    @classmethod
    def joined(cls, blocks: Sequence["Motion"]) -> "Motion":
        return cls(
            np.concatenate([block.speeds_rad_s for block in blocks]),
            np.concatenate([block.are_speeds_known for block in blocks]),
            np.concatenate([block.approaches for block in blocks]),
        )


@dataclass(frozen=True, slots=True, eq=False)
class _MotionSegment:
    """Past samples: times (n,); readings, pointers, directions (n, n_joints)."""

    times_ns: Integers
    angles_rad: Floats
    pointers_rad: Floats
    approaches: Floats


class JointMotionTracker:
    """Follows the joints through a stream.

    Args:
        bands_rad: return that reverses the direction of each joint, (n_joints,).
    """

    def __init__(self, bands_rad: Floats) -> None:
        self._half_bands_rad = 0.5 * bands_rad
        self.forget()

    def forget(self) -> None:
        n_joints = len(self._half_bands_rad)
        self._past: deque[_MotionSegment] = deque()
        # The samples that the next speeds may count from.
        self._times_ns: Integers = np.empty(0, np.int64)
        self._angles_rad: Floats = np.empty((0, n_joints))

    @property
    def state(self) -> dict[str, NDArray[Any]]:
        """State for `resume`; empty before the first sample."""
        if not self._past:
            return {}
        last = self._past[-1]
        return {
            "times_ns": last.times_ns[-1:],
            "angles_rad": last.angles_rad[-1:],
            "pointers_rad": last.pointers_rad[-1:],
            "approaches": last.approaches[-1:],
        }

    def resume(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Continue from an earlier `state`; speeds begin again."""
        self.forget()
        if state:
            last = _MotionSegment(**state)
            self._past.append(last)
            self._times_ns, self._angles_rad = last.times_ns, last.angles_rad

    def add(
        self, times_ns: Integers, angles_rad: Floats, are_valid: Booleans
    ) -> Motion:
        """Continue by a nonempty block.

        Times and validity are (n_samples,), readings (n_samples, n_joints).
        """
        before_ns = self._times_ns[-1:] if self._past else times_ns[:1] - 1
        steps_ns = np.diff(times_ns, prepend=before_ns)
        begins = (steps_ns <= 0) | (steps_ns > GAP_NS) | ~are_valid
        begins[1:] |= ~are_valid[:-1]
        runs = []
        bounds = [0, *(np.flatnonzero(begins[1:]) + 1).tolist(), len(times_ns)]
        for start, end in pairwise(bounds):
            if begins[start]:
                self.forget()
            runs.append(self._run(times_ns[start:end], angles_rad[start:end]))
        if not are_valid[-1]:
            self.forget()
        return runs[0] if len(runs) == 1 else Motion.joined(runs)

    def at_instant(self, time_ns: int, angles_rad: Floats) -> Motion:
        """Return the motion at a latch, (n_joints,), by the samples before it.

        The stream does not advance; samples after the latch do not matter.
        """
        unknown = np.zeros((1, len(angles_rad)))
        before = self._latest(time_ns)
        if before is None or time_ns - before[0].times_ns[before[1]] > GAP_NS:
            return Motion(unknown, np.zeros(1, np.bool_), unknown)
        segment, row = before
        pointers_rad = segment.pointers_rad[row]
        pushed = np.sign(self._pushed(pointers_rad, angles_rad) - pointers_rad)
        approaches = np.where(pushed != 0.0, pushed, segment.approaches[row])
        since, row = self._latest(time_ns - SPEED_NS) or (self._past[0], 0)
        elapsed_ns = time_ns - int(since.times_ns[row])
        if elapsed_ns <= 0:
            return Motion(unknown, np.zeros(1, np.bool_), approaches[np.newaxis])
        speeds_rad_s = (angles_rad - since.angles_rad[row]) / (elapsed_ns * 1e-9)
        return Motion(
            speeds_rad_s[np.newaxis], np.ones(1, np.bool_), approaches[np.newaxis]
        )

    def _run(self, times_ns: Integers, angles_rad: Floats) -> Motion:
        speeds_rad_s, are_known = self._speeds(times_ns, angles_rad)
        pointers_rad, approaches = self._approaches(angles_rad)
        self._past.append(
            _MotionSegment(times_ns, angles_rad, pointers_rad, approaches)
        )
        while self._past[0].times_ns[-1] < times_ns[-1] - KEPT_NS:
            self._past.popleft()
        return Motion(speeds_rad_s, are_known, approaches)

    def _speeds(
        self, times_ns: Integers, angles_rad: Floats
    ) -> tuple[Floats, Booleans]:
        n_before = len(self._times_ns)
        rows = np.arange(n_before, n_before + len(times_ns))
        times_ns = np.concatenate([self._times_ns, times_ns])
        angles_rad = np.concatenate([self._angles_rad, angles_rad])
        # Where nothing is old enough: the first since the beginning.
        older = np.searchsorted(times_ns, times_ns[rows] - SPEED_NS, side="right") - 1
        since = np.maximum(older, 0)
        are_known = since < rows
        elapsed_s = np.where(are_known, times_ns[rows] - times_ns[since], 1) * 1e-9
        speeds_rad_s = (angles_rad[rows] - angles_rad[since]) / elapsed_s[:, np.newaxis]
        self._times_ns = times_ns[since[-1] :]
        self._angles_rad = angles_rad[since[-1] :]
        return speeds_rad_s, are_known

    def _approaches(self, angles_rad: Floats) -> tuple[Floats, Floats]:
        """Return pointers and directions, both (n_samples, n_joints)."""
        if self._past:
            last_rad = self._past[-1].pointers_rad[-1]
            last_sense = self._past[-1].approaches[-1]
        else:
            last_rad, last_sense = angles_rad[0], np.zeros(angles_rad.shape[1])
        # A sample puts the pointer between two limits. So do several, one after the
        # other, and their limits are found by doubling: no loop over samples.
        low_rad = angles_rad - self._half_bands_rad
        high_rad = angles_rad + self._half_bands_rad
        reach = 1
        while reach < len(angles_rad):
            low, high = low_rad[reach:], high_rad[reach:]
            joined_low = np.minimum(np.maximum(low_rad[:-reach], low), high)
            joined_high = np.minimum(np.maximum(high_rad[:-reach], low), high)
            low_rad[reach:], high_rad[reach:] = joined_low, joined_high
            reach *= 2
        pointers_rad = np.minimum(np.maximum(last_rad, low_rad), high_rad)
        pushed = np.sign(np.diff(pointers_rad, axis=0, prepend=last_rad[np.newaxis]))
        rows = np.arange(len(pushed))[:, np.newaxis]
        latest = np.maximum.accumulate(np.where(pushed != 0.0, rows, -1), axis=0)
        senses = np.take_along_axis(pushed, np.maximum(latest, 0), axis=0)
        return pointers_rad, np.where(latest >= 0, senses, last_sense)

    def _pushed(self, pointers_rad: Floats, angles_rad: Floats) -> Floats:
        low_rad = angles_rad - self._half_bands_rad
        return np.minimum(
            np.maximum(pointers_rad, low_rad), angles_rad + self._half_bands_rad
        )

    def _latest(self, time_ns: int) -> tuple[_MotionSegment, int] | None:
        """Return the last sample at or before a time."""
        for segment in reversed(self._past):
            if segment.times_ns[0] <= time_ns:
                row = np.searchsorted(segment.times_ns, time_ns, side="right") - 1
                return segment, int(row)
        return None
