"""Whether the arm rests: then its samples may be collected for longer."""

import numpy as np

from traverse.arrays import Floats
from traverse.daemon.pose.poses import PoseBlock

REST_NS, REST_MM = 2_000_000_000, 0.1  # so long within so much of one place


class RestDetector:
    """Notices that the probe has stayed at one place.

    Attributes:
        rests: it has, for `REST_NS`.
    """

    def __init__(self) -> None:
        self.rests = False
        self._place_mm: Floats = np.full(3, np.nan)
        self._moved_ns = 0

    def follow(self, poses: PoseBlock, *, is_needed: bool) -> bool:
        """Follow the poses; return whether `rests` has changed.

        Where samples are needed as they come, the arm does not count as at rest.
        """
        now_ns, xyz_mm = int(poses.sample_time_ns[-1]), poses.xyz_mm
        moves = not np.abs(xyz_mm - self._place_mm).max() < REST_MM  # also of NaN
        if moves or is_needed:
            self._place_mm, self._moved_ns = xyz_mm[-1], now_ns
        before, self.rests = self.rests, now_ns - self._moved_ns > REST_NS
        return self.rests != before
