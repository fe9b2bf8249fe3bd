"""Encoders that repeat one count while their joint moves.

Nothing in a repeated count says that it is old. Two observations do:

- A joint stops between two readings, without braking, and its count is exactly constant
  from then on, while other joints move on: an arm that touches something stops so, too.
- A count that has varied in every rest before, by noise, is exactly constant: while
  other joints move, since a joint may be clamped; or all are.
"""

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from traverse.arrays import Booleans, Floats, Integers
from traverse.daemon.conditions.monitor import ConditionMonitor
from traverse.daemon.pose.arm_model import ArmModel
from traverse.daemon.pose.poses import ArmReadings
from traverse.daemon.pose.published import PublishedNumbers
from traverse.daemon.pose.trajectory import INVALID_FLAGS
from traverse.protocol.messages import QualityFlag

CONDITION = "channels"  # that this feeds
CHECK_NS = 50_000_000  # interval of checks
STEP_NS = 1_000_000  # between readings that are looked at, where they are quicker
KEPT_NS = 1_500_000_000
GAP_NS = 400_000_000  # longer: what was before says nothing
SPEED_S = 0.01  # over which a speed is measured, at least
SPEED_ROWS, STILL_ROWS = 2, 5  # fewest steps with motion, and without
STILL_S = 0.05
BRAKING_RAD_S2 = 7.5  # a hand brakes by less while it leads other joints on
TREMOR_RAD_S = 2e-3  # a joint that a hand holds moves at least so fast
TREMOR_COUNTS = 3  # of such a motion that a living encoder shows
MOVED_RAD = 2e-3  # of another joint, meanwhile
REST_S, REST_NS, REST_ROWS = 1.0, 1_000_000_000, 30
REST_COUNTS = 16  # of noise, at most
NOISE_COUNTS = 3  # of noise at any place between two counts, at least
REVERSAL_SHARE = 0.125  # of the steps of noise
NOISY_RESTS = 20
LED_RAD = 0.05  # of another joint in REST_S
LEFT_OUT = INVALID_FLAGS | QualityFlag.STALE.value  # readings that are marked


@dataclass(frozen=True, slots=True)
class _Window:
    """Latest readings.

    Attributes:
        times_s: (m,). counts: (m, n_joints), with fractions.
        count_rad: (n_joints,), always positive.
    """

    times_s: Floats
    counts: Floats
    count_rad: Floats

    def speeds_rad_s(self, begin: int, end: int) -> Floats:
        """Return mean speeds (n_joints,) from one row to another."""
        passed = (self.counts[end] - self.counts[begin]) * self.count_rad
        return np.asarray(passed / (self.times_s[end] - self.times_s[begin]))


class FrozenJointMonitor:
    """Feeds the condition `channels`.

    Attributes:
        counts: of frozen joints, by joint from 0.
    """

    def __init__(
        self,
        conditions: ConditionMonitor,
        published: PublishedNumbers,
    ) -> None:
        self._conditions, self._published = conditions, published
        self.counts: dict[int, float] = {}
        self._noisy_rests: Integers = np.zeros(0, np.int64)
        self._may_rest: Booleans = np.zeros(0, np.bool_)
        self._was_still: Booleans = np.zeros(0, np.bool_)
        self._forget()

    def _forget(self) -> None:
        self._blocks: deque[tuple[Integers, Floats]] = deque()
        self._checked_ns = self._rested_ns = -(2**62)

    @property
    def state(self) -> dict[str, Any]:
        return {
            "frozen": [[joint, count] for joint, count in self.counts.items()],
            "noisy_rests": self._noisy_rests.tolist(),
            "may_rest": self._may_rest.tolist(),
        }

    def resume(self, state: Mapping[str, Any]) -> None:
        self.counts = {int(joint): float(count) for joint, count in state["frozen"]}
        self._noisy_rests = np.array(state["noisy_rests"], np.int64)
        self._may_rest = np.array(state["may_rest"], np.bool_)
        self._was_still = np.zeros_like(self._may_rest)

    def add(self, model: ArmModel, readings: ArmReadings) -> None:
        """Check the readings of all joints."""
        samples = readings.samples
        times_ns, counts = samples.sample_time_ns, readings.counts.astype(np.float64)
        if samples.fractions is not None:
            counts += samples.fractions
        if self.counts:
            self._look_for_motion(model, counts)
        if (readings.quality & LEFT_OUT).any():
            return  # as that of a joint whose stop left its motion so far
        if self._blocks and int(times_ns[0] - self._blocks[-1][0][-1]) > GAP_NS:
            self._forget()
        blocks = self._blocks
        blocks.append(_thinned(times_ns, counts))
        now_ns = int(times_ns[-1])
        if now_ns - self._checked_ns < CHECK_NS:
            return
        while blocks[0][0][-1] < now_ns - KEPT_NS:
            blocks.popleft()
        self._checked_ns = now_ns
        all_ns, all_counts = (
            np.concatenate(parts) for parts in zip(*blocks, strict=True)
        )
        times_s = (all_ns - now_ns) * 1e-9
        window = _Window(times_s, all_counts, np.abs(model.per_count_rad))
        for joint, row in _stopped_joints(window):
            # It froze after the reading before its first constant one.
            text, since_ns = "it stopped without braking", int(all_ns[row - 1])
            self._report(model, joint, counts[-1, joint], text, since_ns)
        if now_ns - self._rested_ns >= REST_NS:
            self._rested_ns = now_ns
            self._judge_noise(model, window)

    def _judge_noise(self, model: ArmModel, window: _Window) -> None:
        rows = window.times_s > -REST_S
        if rows.sum() < REST_ROWS:
            return
        counts = window.counts[rows]
        if len(self._noisy_rests) != counts.shape[1]:
            self._noisy_rests = np.zeros(counts.shape[1], np.int64)
            self._may_rest = np.zeros(counts.shape[1], np.bool_)
            self._was_still = self._may_rest.copy()
        senses = np.sign(np.diff(counts, axis=0))
        reversals = (senses[1:] * senses[:-1] < 0).sum(axis=0)
        spans = np.ptp(counts, axis=0)
        is_noisy = (spans >= NOISE_COUNTS) & (spans <= REST_COUNTS)
        is_noisy &= reversals >= REVERSAL_SHARE * len(counts)
        self._noisy_rests += is_noisy
        is_still = spans == 0
        self._may_rest |= self._was_still & ~is_still
        self._was_still = is_still
        moved_rad = spans * window.count_rad
        suspects = is_still & ~self._may_rest & (self._noisy_rests >= NOISY_RESTS)
        if moved_rad.max() >= LED_RAD or suspects.all():
            for joint in np.flatnonzero(suspects).tolist():
                text, since_ns = "its noise has ended", self._rested_ns - REST_NS
                self._report(model, joint, counts[-1, joint], text, since_ns)

    def _report(
        self, model: ArmModel, joint: int, count: float, why: str, since_ns: int
    ) -> None:
        """Put numbers in doubt; name those that were published before it showed."""
        if joint in self.counts:
            return
        self.counts[joint] = float(count)
        named, data = self._published.between(
            since_ns, self._checked_ns, QualityFlag.STALE
        )
        data["constant_s"] = round((self._checked_ns - since_ns) * 1e-9, 3)
        why += named
        self._doubt(model, why, data)

    def _doubt(
        self, model: ArmModel, why: str, data: Mapping[str, float | str] | None = None
    ) -> None:
        named = ", ".join(
            f"{model.effects.joint_names[joint]} ({model.joint_devices[joint]}/"
            f"{model.channels[joint]})"
            for joint in self.counts
        )
        self._conditions.doubt(
            CONDITION,
            cause=f"the count of {named} is exactly constant while other joints move: "
            f"{why}",
            data=data,
        )

    def _look_for_motion(self, model: ArmModel, counts: Floats) -> None:
        # A block that begins with a frozen count may vary later: it is in doubt whole.
        frozen = {j: c for j, c in self.counts.items() if counts[0, j] == c}
        if len(frozen) == len(self.counts):
            return
        self.counts = frozen
        if frozen:
            self._doubt(model, "it has not moved since")
        else:
            self._conditions.establish(CONDITION, text="every count varies again")


def _thinned(times_ns: Integers, counts: Floats) -> tuple[Integers, Floats]:
    """Return the last reading of a block, and earlier ones at least `STEP_NS` apart."""
    passed_ns = max(int(times_ns[-1] - times_ns[0]), 1)
    step = max(STEP_NS * (len(times_ns) - 1) // passed_ns, 1)
    kept = np.arange(len(times_ns) - 1, -1, -step)[::-1]
    return times_ns[kept], counts[kept]


def _stopped_joints(window: _Window) -> list[tuple[int, int]]:
    """Return joints, from 0, that stopped without braking while others moved on.

    Beside each: the row from which on its count is constant. That the whole arm rests
    meanwhile changes nothing.
    """
    latest = window.counts[-STILL_ROWS - 1 :]
    may_be = (latest == latest[-1]).all(axis=0)
    if len(latest) <= STILL_ROWS or not may_be.any():
        return []
    has_moved = window.counts[1:] != window.counts[:-1]
    rows = {
        joint: 1 + int(np.flatnonzero(has_moved[:, joint])[-1])
        for joint in np.flatnonzero(may_be & has_moved.any(axis=0)).tolist()
    }
    return [it for it in rows.items() if _has_stopped(window, *it)]


def _has_stopped(window: _Window, joint: int, row: int) -> bool:
    """Return whether a joint that is still from a row on has stopped without braking.

    Strategy: a joint that brakes to rest within the last step with motion had the mean
    speed a (dt + h / 2) over the time h before that step. Quantisation adds a count to
    either end of h.
    """
    times_s, count_rad = window.times_s, window.count_rad[joint]
    still_s = float(times_s[-1] - times_s[row])
    if still_s < max(STILL_S, TREMOR_COUNTS * count_rad / TREMOR_RAD_S):
        return False
    moving = row - 1
    begin = int(np.searchsorted(times_s, times_s[moving] - SPEED_S, side="right")) - 1
    begin = min(begin, moving - SPEED_ROWS)
    if begin < 0:
        return False
    senses = np.sign(np.diff(window.counts[begin : row + 1, joint]))
    if senses.min() * senses.max() < 0:
        return False  # a single spoilt count of a joint at rest, there and back
    last_s, span_s = times_s[row] - times_s[moving], times_s[moving] - times_s[begin]
    least_rad_s = BRAKING_RAD_S2 * (last_s + span_s / 2) + 2.0 * count_rad / span_s
    before_rad_s = window.speeds_rad_s(begin, moving)
    if abs(before_rad_s[joint]) <= least_rad_s:
        return False
    end = int(np.searchsorted(times_s, times_s[row] + STILL_S))
    after_rad_s = window.speeds_rad_s(row, min(end, len(times_s) - 1))
    passed_rad = np.abs(window.counts[-1] - window.counts[row]) * window.count_rad
    shares = after_rad_s * before_rad_s / np.maximum(before_rad_s**2, 1e-12)
    goes_on = (shares > 0.5) & (shares < 2.0) & (passed_rad > MOVED_RAD)
    return bool(goes_on.any())
