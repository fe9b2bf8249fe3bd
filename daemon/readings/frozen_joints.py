"""Encoders that repeat one count while their joint moves.

Nothing in a repeated count says that it is old. Two observations do:

- A joint stops between two readings, without braking, and its count is exactly constant
  from then on, while other joints move on: an arm that touches something stops so, too.
- A count that has varied in every rest before, by noise, is exactly constant: while
  other joints move, since a joint may be clamped; or all are.

Both are observed in the readings themselves: interpolation at the instants of samples
would spread a stop over two of them.
"""

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from traverse.arrays import Booleans, Floats, Integers
from traverse.daemon.conditions.monitor import ConditionMonitor
from traverse.daemon.pose.arm_model import ArmModel
from traverse.daemon.pose.poses import ArmReadings
from traverse.daemon.pose.published import PublishedNumbers
from traverse.daemon.pose.trajectory import INVALID_FLAGS
from traverse.daemon.readings.stops import (
    GAP_NS,
    Series,
    Window,
    stopped_joints,
    thinned,
)
from traverse.protocol.messages import QualityFlag

CONDITION = "channels"  # that this feeds
CHECK_NS = 50_000_000  # interval of checks
KEPT_NS = 1_500_000_000
REST_S, REST_NS, REST_ROWS = 1.0, 1_000_000_000, 30
REST_COUNTS = 16  # of noise, at most
NOISE_COUNTS = 3  # of noise at any place between two counts, at least
REVERSAL_SHARE = 0.125  # of the steps of noise
NOISY_RESTS = 20
LED_RAD = 0.05  # of another joint in REST_S
LEFT_OUT = INVALID_FLAGS | QualityFlag.STALE.value  # readings that are marked


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

    def add(
        self,
        model: ArmModel,
        readings: ArmReadings,
        series_between: Callable[[int, int], Sequence[Series]] | None = None,
    ) -> None:
        """Check the readings of all joints.

        Args:
            model: the arm.
            readings: of all joints at the same instants.
            series_between: where these are interpolated, what of: the readings of a
                time.
        """
        samples = readings.samples
        times_ns, counts = samples.sample_time_ns, readings.counts.astype(np.float64)
        if samples.fractions is None:
            series_between = None
        else:
            counts += samples.fractions
        if self.counts:
            self._look_for_motion(model, counts)
        if series_between is None and not self._keep(readings, counts):
            return
        now_ns = int(times_ns[-1])
        if 0 <= now_ns - self._checked_ns < CHECK_NS:
            return
        self._checked_ns = now_ns
        if series_between is None:
            series: Sequence[Series] = [self._kept(now_ns)]
        else:
            series = series_between(now_ns - KEPT_NS, now_ns)
        window = Window(series, np.abs(model.per_count_rad))
        for joint, before_s in stopped_joints(window):
            # It froze after the reading before its first constant one.
            since_ns = now_ns + round(before_s * 1e9)
            text = "it stopped without braking"
            self._report(model, joint, counts[-1, joint], text, since_ns)
        if now_ns - self._rested_ns >= REST_NS:
            self._rested_ns = now_ns
            self._judge_noise(model, window, counts[-1])

    def _keep(self, readings: ArmReadings, counts: Floats) -> bool:
        """Keep readings that are all of one instant; False if some are left out."""
        times_ns = readings.samples.sample_time_ns
        if (readings.quality & LEFT_OUT).any():
            return False  # as that of a joint whose stop left its motion so far
        if self._blocks and int(times_ns[0] - self._blocks[-1][0][-1]) > GAP_NS:
            self._forget()
        self._blocks.append(thinned(times_ns, counts))
        return True

    def _kept(self, now_ns: int) -> Series:
        blocks = self._blocks
        while blocks[0][0][-1] < now_ns - KEPT_NS:
            blocks.popleft()
        all_ns, counts = (np.concatenate(parts) for parts in zip(*blocks, strict=True))
        times_s = np.broadcast_to(((all_ns - now_ns) * 1e-9)[:, None], counts.shape)
        return Series(
            np.arange(counts.shape[1]), times_s, np.zeros(counts.shape), counts
        )

    def _judge_noise(self, model: ArmModel, window: Window, last: Floats) -> None:
        n_joints = len(window.count_rad)
        if sum(len(series.joints) for series in window.series) < n_joints:
            return
        spans, is_noisy = np.zeros(n_joints), np.zeros(n_joints, np.bool_)
        for series in window.series:
            counts = series.counts[(series.times_s > -REST_S).all(axis=1)]
            if len(counts) < REST_ROWS:
                return
            senses = np.sign(np.diff(counts, axis=0))
            reversals = (senses[1:] * senses[:-1] < 0).sum(axis=0)
            spans[series.joints] = np.ptp(counts, axis=0)
            is_noisy[series.joints] = reversals >= REVERSAL_SHARE * len(counts)
        if len(self._noisy_rests) != n_joints:
            self._noisy_rests = np.zeros(n_joints, np.int64)
            self._may_rest = np.zeros(n_joints, np.bool_)
            self._was_still = self._may_rest.copy()
        is_noisy &= (spans >= NOISE_COUNTS) & (spans <= REST_COUNTS)
        self._noisy_rests += is_noisy
        is_still = spans == 0
        self._may_rest |= self._was_still & ~is_still
        self._was_still = is_still
        moved_rad = spans * window.count_rad
        suspects = is_still & ~self._may_rest & (self._noisy_rests >= NOISY_RESTS)
        if moved_rad.max() >= LED_RAD or suspects.all():
            for joint in np.flatnonzero(suspects).tolist():
                text, since_ns = "its noise has ended", self._rested_ns - REST_NS
                self._report(model, joint, last[joint], text, since_ns)

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
