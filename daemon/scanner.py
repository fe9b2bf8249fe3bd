"""Timed scans: every k-th sample of the device's stream, in blocks."""

import uuid
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from daemon.clock import HostClock
from daemon.model import ArmModel
from daemon.poses import PoseBlock
from protocol.messages import Scan

MAX_POINTS = 1000  # of a message: half a megabyte with 32 joints


@dataclass(frozen=True, slots=True)
class ScanPlan:
    """A scan as it was asked for.

    Attributes:
        rate_hz: points per second.
        every: the device streams at ``every * rate_hz``, and one sample in ``every``
            becomes a point, so that slow scans still follow the joints' turns.
    """

    id: str
    rate_hz: float
    every: int

    @property
    def device_rate_hz(self) -> float:
        """The rate to ask the device for."""
        return self.rate_hz * self.every


def plan_scan(rate_hz: float, tracking_rate_hz: float) -> ScanPlan:
    """A new scan at ``rate_hz`` on a stream of at least the tracking rate."""
    every = max(1, int(np.ceil(tracking_rate_hz / rate_hz)))
    return ScanPlan(uuid.uuid4().hex[:12], rate_hz, every)


class Scanner:
    """Collects the points of one running scan and hands them on block by block.

    Numbers count sampling instants from the scan's start. What was lost on the line,
    or while the device was away, leaves a gap in them.

    Args:
        clock: the host's.
        offer: hands a block to the outgoing queue; False if it was dropped.
        block_s: time that a block spans.
    """

    def __init__(
        self, clock: HostClock, offer: Callable[[Scan], bool], block_s: float
    ) -> None:
        self._clock = clock
        self._offer = offer
        self._block_s = block_s
        self.plan: ScanPlan | None = None
        self.session = ""
        self.dropped_points = 0
        self.published_points = 0

    def start(self, plan: ScanPlan, model: ArmModel, session: str) -> None:
        """Begin; points come as soon as the device streams at the plan's rate."""
        self.plan = plan
        self.session = session
        self._model = model
        self._stream: int | None = None
        self._offset = 0
        self._next = 0
        self._last_ns = 0
        self._waiting: list[PoseBlock] = []
        self._n_waiting = 0
        self._lost = 0
        self._dropped = 0

    def follow(self, stream: int, rate_hz: float) -> bool:
        """The device has begun a stream; True if it is the one the scan waits for."""
        plan = self.plan
        if plan is None or abs(rate_hz - plan.device_rate_hz) > 0.001 * rate_hz + 0.001:
            return False
        self._stream = stream
        self._resuming = self._next > 0 or self._n_waiting > 0
        return True

    def take(self, model: ArmModel, poses: PoseBlock) -> None:
        """Add the points of a block of poses."""
        plan = self.plan
        if plan is None or poses.stream != self._stream:
            return
        rows = poses.seq % plan.every == 0
        if not rows.any():
            return
        if model is not self._model:
            self._flush()
            self._model = model
        points = poses.rows(rows)
        numbers = points.seq // plan.every
        if self._resuming:
            self._offset = self._number_at(points.sample_time_ns[0]) - int(numbers[0])
            self._resuming = False
        points = points.numbered(numbers + self._offset)
        self._last_ns = int(points.sample_time_ns[-1])
        self._last_number = int(points.seq[-1])
        self._waiting.append(points)
        self._n_waiting += len(points.seq)
        if self._n_waiting >= plan.rate_hz * self._block_s:
            self._flush()

    def stop(self) -> int:
        """End the scan; gives how many points it has, lost and dropped included."""
        if self.plan is None:
            return 0
        self._flush(last=True)
        self.plan = None
        return self._next

    def _number_at(self, sample_time_ns: int) -> int:
        """The number that a sample at this time has, counting through the outage."""
        plan = self.plan
        if plan is None:
            return 0
        missed = (int(sample_time_ns) - self._last_ns) * 1e-9 * plan.rate_hz
        return self._last_number + max(1, round(missed))

    def _flush(self, *, last: bool = False) -> None:
        blocks, self._waiting, self._n_waiting = self._waiting, [], 0
        if blocks:
            points = PoseBlock.joined(blocks)
            # A message's numbers are consecutive: a gap begins a new message. After a
            # stall many points come at once: no message grows beyond its bound.
            n = len(points.seq)
            gaps = np.flatnonzero(np.diff(points.seq) != 1) + 1
            bounds = sorted({*range(0, n, MAX_POINTS), *gaps.tolist(), n})
            for start, end in pairwise(bounds):
                final = last and end == bounds[-1]
                self._publish(points.rows(slice(start, end)), last=final)
        elif last:
            self._publish(None, last=True)

    def _publish(self, points: PoseBlock | None, *, last: bool) -> None:
        plan = self.plan
        if plan is None:
            return
        n_joints = self._model.encoders.n_joints
        first, n = self._next, 0
        if points is not None:
            first, n = int(points.seq[0]), len(points.seq)
            self._lost += first - self._next
            self._next = first + n
            times_ns = points.sample_time_ns
        else:
            times_ns = np.array([self._last_ns or self._clock.monotonic_ns()])
        message = Scan(
            session=self.session,
            scan=plan.id,
            seq=first,
            arm=self._model.name,
            model=self._model.digest,
            mode="time",
            rate_hz=plan.rate_hz,
            probe_radius_mm=self._model.probe_radius_mm,
            time_ns=self._clock.to_utc_ns(int(times_ns[0])),
            dtime_ns=np.maximum.accumulate(times_ns[:n] - times_ns[0]),
            xyz_mm=np.zeros((0, 3)) if points is None else points.xyz_mm,
            ijk=np.zeros((0, 3)) if points is None else points.ijk,
            angles_rad=np.zeros((0, n_joints)) if points is None else points.angles_rad,
            counts=np.zeros((0, n_joints), np.int64)
            if points is None
            else points.counts,
            part_xyz_mm=None,
            quality=np.zeros(0, np.uint32) if points is None else points.quality,
            dropped=self._dropped,
            lost=self._lost,
            last=last,
            total=self._next if last else None,
        )
        if self._offer(message):
            self.published_points += n
        else:
            self._dropped += n
            self.dropped_points += n
