"""From the ball's centre to the touched point, if the direction of touch is known.

`traverse.kinematics.probing.compensation` has the geometry. Where the direction of the
material is known, the effects of the contact are applied too; where it is required and
unknown, the point is flagged.
"""

from dataclasses import dataclass, replace

import numpy as np

from traverse.arrays import Floats
from traverse.daemon.config.schema import CaptureSection
from traverse.daemon.points.capture import PointMeasurement
from traverse.daemon.pose.poses import PoseBlock
from traverse.daemon.pose.trajectory import TrajectoryBuffer, first_sample_beyond
from traverse.kinematics.effects.pose import contact_shifts, pose_flags
from traverse.kinematics.probing.compensation import (
    DirectionError,
    surface_point,
    towards_material,
)
from traverse.protocol.messages import QualityFlag

UNKNOWN = QualityFlag.SURFACE_UNKNOWN.value


@dataclass(slots=True, eq=False)
class RetractDetector:
    """Watch in which direction the probe is pulled away after a touch.

    Attributes:
        from_ns, from_mm: instant and place of the touch.
        distance_mm: distance at which the probe is off the surface.
        until_ns: deadline.
        place_mm: first place off the surface; None before it.
    """

    from_ns: int
    from_mm: Floats
    distance_mm: float
    until_ns: int
    place_mm: Floats | None = None

    def add(self, poses: PoseBlock) -> None:
        if self.place_mm is None:
            beyond = first_sample_beyond(
                poses, self.from_ns, self.from_mm, self.distance_mm
            )
            if beyond is not None and beyond[0] <= self.until_ns:
                self.place_mm = beyond[1]

    def is_over(self, path: TrajectoryBuffer, now_ns: int, wait_ns: int) -> bool:
        """Whether the probe was pulled away, or the wait has ended."""
        last_ns = path.last_ns
        seen_all = last_ns is not None and last_ns > self.until_ns
        return self.place_mm is not None or seen_all or now_ns > self.until_ns + wait_ns


class TipCompensator:
    """Compensate for the ball as configured.

    Attributes:
        air_mm: a place in the air, from which the next point is touched; or None.
    """

    def __init__(self, settings: CaptureSection, path: TrajectoryBuffer) -> None:
        self._method = settings.compensation
        self._settings = settings
        self._path = path
        middle_mm = settings.middle_mm
        self._middle_mm = None if middle_mm is None else np.array(middle_mm)
        self.air_mm: Floats | None = None

    @property
    def follows_stream(self) -> bool:
        return self._method in ("pretouch", "pulled")

    @property
    def needs_trajectory(self) -> bool:
        return self._method == "pretouch"

    def before(self, time_ns: int, place_mm: Floats) -> Floats | None:
        """Earlier place of the probe, (3,); None where it does not matter."""
        if self._method != "pretouch":
            return None
        distance_mm = self._settings.pretouch_mm
        return self._path.last_position_beyond_mm(time_ns, place_mm, distance_mm)

    def pull(self, time_ns: int, place_mm: Floats) -> RetractDetector | None:
        """Watch the probe from now on; None where it does not matter."""
        if self._method != "pulled":
            return None
        settings = self._settings
        until_ns = time_ns + int(settings.pull_s * 1e9)
        pull = RetractDetector(time_ns, place_mm, settings.pull_mm, until_ns)
        for block in self._path.between(time_ns, until_ns):
            pull.add(block)
        return pull

    def compensated(
        self, measured: PointMeasurement, pull: RetractDetector | None
    ) -> PointMeasurement:
        """Add the touched place to a point.

        Raises:
            DirectionError: it is not known; `without_direction` marks the point.
        """
        method, pose = self._method, measured.pose
        if method == "none":
            return measured
        other_mm = self._middle_mm
        if method == "pretouch":
            other_mm = self._pretouch_mm(measured)
        elif method == "pulled":
            other_mm = None if pull is None else pull.place_mm
        towards = towards_material(method, pose.xyz_mm, pose.ijk, other_mm)
        model = measured.model
        # Along the shank is a habit, not a measured direction: no effect rests on it.
        if model.effects.contacts and method != "shank":
            block = replace(pose.block, directions=towards[np.newaxis])
            shift_mm = contact_shifts(model.geometry, model.effects, block)[0]
            is_unknown = pose_flags(model.effects, block).surface_unknown[0]
            quality = (pose.quality & ~UNKNOWN) | UNKNOWN * int(is_unknown)
            pose = replace(
                pose, xyz_mm=pose.xyz_mm + shift_mm, quality=quality, block=block
            )
        return replace(
            measured,
            pose=pose,
            surface_mm=surface_point(pose.xyz_mm, towards, model.probe_radius_mm),
            compensation=method,
        )

    def _pretouch_mm(self, measured: PointMeasurement) -> Floats | None:
        """Return the place from which a point was touched; that in the air counts once.

        Raises:
            DirectionError: the probe came from the other side than that of the air.
        """
        (air_mm, self.air_mm), before_mm = (self.air_mm, None), measured.before_mm
        if air_mm is None or before_mm is None:
            return before_mm if air_mm is None else air_mm
        at_mm = measured.pose.xyz_mm
        if (at_mm - air_mm) @ (at_mm - before_mm) < 0.0:
            raise DirectionError(
                "pretouch: the place in the air lies on the other side of where the "
                "probe came from, that of an earlier touch, perhaps; take the point "
                "again, with a place in the air on its own side, or without"
            )
        return air_mm


def without_direction(measured: PointMeasurement) -> PointMeasurement:
    """Mark the point: a direction is required and unknown."""
    pose = measured.pose
    return replace(measured, pose=replace(pose, quality=pose.quality | UNKNOWN))
