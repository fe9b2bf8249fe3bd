"""From a pose to a captured point: number, label, flags."""

import hashlib
import uuid
from collections import OrderedDict, deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from traverse.arrays import Floats
from traverse.daemon.clock import HostClock
from traverse.daemon.config.schema import CaptureSection
from traverse.daemon.errors import CaptureRefusedError
from traverse.daemon.pose.alignment import ActiveAlignment
from traverse.daemon.pose.arm_model import ArmModel
from traverse.daemon.pose.poses import LatchedPose
from traverse.daemon.store.records import PendingPoint
from traverse.protocol.messages import Label, Point, Quality
from traverse.protocol.messages.point import Compensation, Covariance, Trigger

MAX_UNDONE = 1000  # points that can be taken back, one after the other


class Session:
    """A list of points, numbered from 0; a new one at each start of the daemon.

    Args:
        begun_ns: when it began [UTC].
        before: id of the session that it follows; None: the first of a run.

    Attributes:
        id: unique for ever. That of a first session is random, and each next one
            follows from it, so that a replay gives the same ids.
        next_seq: number of the next point or retraction.
    """

    def __init__(
        self, begun_ns: int, note: str = "", before: str | None = None
    ) -> None:
        if before is None:
            self.id = uuid.uuid4().hex
        else:
            self.id = hashlib.blake2b(before.encode(), digest_size=16).hexdigest()
        self.begun_ns = begun_ns
        self.note = note
        self.next_seq = 0
        self._standing: deque[Point] = deque(maxlen=MAX_UNDONE)
        self._retracted: dict[str, Point] = {}

    @property
    def next_id(self) -> str:
        return f"{self.id}-{self.next_seq}"

    @property
    def last(self) -> Point | None:
        return self._standing[-1] if self._standing else None

    def since(self, utc_ns: int) -> list[Point]:
        return [point for point in self._standing if point.time_ns >= utc_ns]

    def add(self, point: Point) -> None:
        """Count a point or retraction that was handed on."""
        self.next_seq += 1
        if point.retracts is None:
            self._standing.append(point)
        else:
            self._retracted[point.id] = self._standing.pop()

    def confirm(self, point: Point) -> None:
        """Mark the oldest point handed on as stored: it is never rolled back."""
        self._retracted.pop(point.id, None)

    def roll_back(self, point: Point) -> None:
        """Forget the newest point handed on, which was not stored."""
        self.next_seq -= 1
        if point.retracts is None:
            self._standing.pop()
        else:
            self._standing.append(self._retracted.pop(point.id))


class ActiveSession:
    """The session that points belong to; a new one at each start of the daemon."""

    def __init__(self, clock: HostClock) -> None:
        self._clock = clock
        self.session = Session(self._now_ns())

    def begin(self, note: str = "") -> Session:
        self.session = Session(self._now_ns(), note, self.session.id)
        return self.session

    def _now_ns(self) -> int:
        return self._clock.to_utc_ns(self._clock.monotonic_ns())


PointWriter = Callable[[Point, int, str], PendingPoint | None]
"""Write a point of a session that began at a time [UTC ns], with its note."""
MOST_SHARED = 1000
"""Number of points whose shared uncertainty is kept, some 600 bytes each."""
QUEUE_FULL = (
    "so many points wait for the disk that no more can be taken",
    "wait until the disk has caught up, then try again; see `outbox` in health",
)


@dataclass(frozen=True, slots=True, eq=False)
class PointMeasurement:
    """Measured values of a point.

    Attributes:
        model: arm that it was measured with.
        pose: pose of one latch, or the mean of several samples.
        temperature_c: temperature of the arm; None without a sensor.
        covariance_mm2: covariance of the ball's centre.
        time_bound_ns: how far the instant may be off; None: nothing states it.
        shared_mm: part that points share by the arm's parameters, (3, rank).
        samples, spread_mm: number of averaged samples, and their spread.
        before_mm: earlier place of the probe, (3,); None where it does not matter.
        surface_mm: the touched point, (3,), by ``compensation``.
    """

    model: ArmModel
    pose: LatchedPose
    temperature_c: float | None
    covariance_mm2: Covariance | None = None
    time_bound_ns: int | None = None
    shared_mm: Floats | None = None
    samples: int = 1
    spread_mm: float | None = None
    before_mm: Floats | None = None
    surface_mm: Floats | None = None
    compensation: Compensation = "none"


class SharedUncertainties:
    """Uncertainties that the latest points share, for their differences."""

    def __init__(self) -> None:
        self._latest: OrderedDict[str, tuple[Point, Floats]] = OrderedDict()

    def keep(self, point: Point, shared_mm: Floats | None) -> None:
        """Keep the share of a point; drop the oldest one's."""
        if shared_mm is not None:
            self._latest[point.id] = (point, shared_mm.copy())
        if len(self._latest) > MOST_SHARED:
            self._latest.popitem(last=False)

    def of(self, point_id: str) -> tuple[Point, Floats] | None:
        """A point and its share, (3, rank); None if it is not kept."""
        return self._latest.get(point_id)


class Capture:
    """Make points; one that is refused, or not kept, uses up no number.

    Args:
        write: writes a point to the disk; None if there is no room for it.
    """

    def __init__(
        self,
        clock: HostClock,
        write: PointWriter,
        part: ActiveAlignment | None = None,
        active: ActiveSession | None = None,
    ) -> None:
        self._clock = clock
        self.part = part or ActiveAlignment()
        self._write = write
        self._active = active or ActiveSession(clock)
        self.label = Label()
        self.shared = SharedUncertainties()
        self.captured = 0
        self.retracted = 0
        self.refused = 0

    @property
    def session(self) -> Session:
        return self._active.session

    def points_since(self, utc_ns: int) -> list[Point]:
        return self.session.since(utc_ns)

    def take(self, measured: PointMeasurement, trigger: Trigger) -> PendingPoint:
        """Capture a point; it counts as soon as it is on the disk.

        Raises:
            CaptureRefusedError: there is no room for it.
        """
        pose, surface_mm = measured.pose, measured.surface_mm
        session = self.session
        point = Point(
            session=session.id,
            seq=session.next_seq,
            id=session.next_id,
            retracts=None,
            arm=measured.model.name,
            model=measured.model.digest,
            trigger=trigger,
            time_ns=self._clock.to_utc_ns(pose.sample_time_ns),
            time_bound_ns=measured.time_bound_ns,
            xyz_mm=tuple(pose.xyz_mm.tolist()),
            ijk=tuple(pose.ijk.tolist()),
            surface_mm=None if surface_mm is None else tuple(surface_mm.tolist()),
            compensation=measured.compensation,
            part_xyz_mm=self.part.part_mm(pose.xyz_mm),
            covariance_mm2=measured.covariance_mm2,
            angles_rad=tuple(pose.angles_rad.tolist()),
            counts=tuple(pose.counts.tolist()),
            temperature_c=measured.temperature_c,
            probe_radius_mm=measured.model.probe_radius_mm,
            samples=measured.samples,
            spread_mm=measured.spread_mm,
            label=self.label,
            quality=Quality.from_bits(pose.quality),
        )
        pending = self._submit(point)
        self.shared.keep(point, measured.shared_mm)
        return pending

    def undo(self, trigger: Trigger, point_id: str | None = None) -> PendingPoint:
        """Retract the last point that is not retracted, or only if it has this id.

        Raises:
            CaptureRefusedError: there is none, it is another, or there is no room.
        """
        last = self.session.last
        if last is None:
            raise CaptureRefusedError(
                "this session has no point that could be taken back",
                "points of earlier sessions cannot be undone; leave them out by hand",
            )
        if point_id not in (None, last.id):
            raise CaptureRefusedError(
                f"the last point that is not retracted is {last.id}, not {point_id}",
                "undo the last one first, or leave the id out",
            )
        retraction = last.retraction(
            seq=self.session.next_seq,
            point_id=self.session.next_id,
            trigger=trigger,
            time_ns=self._clock.to_utc_ns(self._clock.monotonic_ns()),
        )
        return self._submit(retraction)

    def begin_session(self, note: str = "") -> Session:
        self.label = Label()
        return self._active.begin(note)

    def _submit(self, point: Point) -> PendingPoint:
        session = self.session
        write = self._write(point, session.begun_ns, session.note)
        if write is None:
            raise CaptureRefusedError(*QUEUE_FULL)
        session.add(point)
        write.on_roll_back(lambda: session.roll_back(point))

        def on_settled() -> None:
            if write.trouble is None:
                session.confirm(point)
                self.captured += point.retracts is None
                self.retracted += point.retracts is not None

        write.on_settled(on_settled)
        return write


Triggers = Mapping[tuple[str, int | None], Trigger]
"""Kind of the trigger that is wired to an input of a device."""


def triggers_of(settings: CaptureSection) -> Triggers:
    return {(i.device_id, i.number): i.trigger for i in settings.inputs}
