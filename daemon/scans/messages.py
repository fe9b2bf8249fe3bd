"""Messages of one scan: consecutive numbers in a block, losses stated."""

import numpy as np

from traverse.daemon.clock import HostClock
from traverse.daemon.pose.alignment import Alignment
from traverse.daemon.pose.arm_model import ArmModel
from traverse.daemon.scans.plan import ScanPlan
from traverse.kinematics.filters import PointBlock
from traverse.protocol.messages import Scan


class ScanMessages:
    """Makes the messages of a scan, in order.

    Attributes:
        next: number after the last one.
    """

    def __init__(self, clock: HostClock, plan: ScanPlan, session: str) -> None:
        self._clock = clock
        self._plan = plan
        self._session = session
        self._lost = 0
        self.next = 0
        self.dropped = 0

    def message(
        self,
        model: ArmModel,
        alignment: Alignment | None,
        points: PointBlock,
        total: int | None,
    ) -> Scan:
        """The next one, of consecutive points; at the end perhaps of `empty_block`.

        The last one has the total of the scan's points, lost and dropped included.
        """
        plan, n = self._plan, len(points)
        first = int(points.seq[0]) if n else self.next
        end = max(first + n, total or 0)
        self._lost += first - self.next + end - (first + n)
        self.next = end
        begin_ns = int(points.time_ns[0])
        return Scan(
            session=self._session,
            scan=plan.id,
            seq=first,
            arm=model.name,
            model=model.digest,
            mode=plan.mode,
            rate_hz=plan.rate_hz if plan.mode == "time" else None,
            probe_radius_mm=model.probe_radius_mm,
            time_ns=self._clock.to_utc_ns(begin_ns),
            dtime_ns=np.maximum.accumulate(points.time_ns[:n] - begin_ns),
            xyz_mm=points.xyz_mm,
            ijk=points.ijk,
            angles_rad=points.angles_rad,
            counts=points.counts,
            part_xyz_mm=None
            if alignment is None
            else alignment.transform_mm(points.xyz_mm),
            quality=points.quality,
            dropped=self.dropped,
            lost=self._lost,
            last=total is not None,
            total=total,
        )


def empty_block(n_joints: int, time_ns: int) -> PointBlock:
    """A time without a point."""
    return PointBlock(
        np.zeros(0, np.int64),
        np.array([time_ns], dtype=np.int64),
        np.zeros((0, 3)),
        np.zeros((0, 3)),
        np.zeros((0, n_joints)),
        np.zeros((0, n_joints), np.int64),
        np.zeros(0, np.uint32),
    )
