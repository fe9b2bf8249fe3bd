"""The commands of an arm as functions with typed answers."""

import asyncio
from collections import OrderedDict
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, TypedDict, Unpack

import numpy as np

from traverse.arrays import Floats
from traverse.client.errors import NoAnswerError
from traverse.client.requests import CommandClient
from traverse.client.results import (
    CapturedPoint,
    PointCovariances,
    Resent,
    ResentScan,
    SharedErrors,
    StartedScan,
    StoredSession,
)
from traverse.protocol.messages import (
    AlignArgs,
    Args,
    CovarianceArgs,
    HomeArgs,
    LabelArgs,
    Point,
    PointArgs,
    ProbeArgs,
    Reading,
    ReferenceArgs,
    ReloadArgs,
    ResendArgs,
    ScanArgs,
    SessionArgs,
    UndoArgs,
)
from traverse.protocol.messages.fields import Vector
from traverse.protocol.messages.scan import ScanMode

if TYPE_CHECKING:
    from traverse.kinematics.uncertainty.joint_covariance import (
        JointCovariance,
        Length,
    )

ARRIVAL_S = 1.0
MEAN_S = 60.0
MAX_REMEMBERED = 256


class PointIndex:
    """The latest received points by id."""

    def __init__(self) -> None:
        self._latest: OrderedDict[str, Point] = OrderedDict()
        self._waiting: dict[str, asyncio.Future[Point]] = {}

    def take(self, point: Point) -> None:
        self._latest[point.id] = point
        if len(self._latest) > MAX_REMEMBERED:
            self._latest.popitem(last=False)
        waiting = self._waiting.get(point.id)
        if waiting is not None and not waiting.done():
            waiting.set_result(point)

    async def get(self, point_id: str, seconds: float) -> Point | None:
        """Return a point that has arrived, or arrives within this time."""
        if point_id in self._latest:
            return self._latest[point_id]
        future: asyncio.Future[Point] = asyncio.get_running_loop().create_future()
        self._waiting[point_id] = future
        try:
            await asyncio.wait({future}, timeout=seconds)
            return future.result() if future.done() else None
        finally:
            future.cancel()
            del self._waiting[point_id]


class ScanOptions(TypedDict, total=False):
    """Arguments of the command `scan` beside its mode, which explains them."""

    rate_hz: float | None
    spacing_mm: float | None
    normal: Iterable[float] | None
    offset_mm: float
    held: bool


class ArmCommands:
    """Commands of an arm.

    Every command raises CommandRefused if the arm refuses, and NoAnswerError if there
    is no answer in time.

    Args:
        requests: sends commands to the arm.

    Attributes:
        by_id: the latest received points.
    """

    def __init__(self, requests: CommandClient, reply_timeout_s: float) -> None:
        self._requests = requests
        self._reply_timeout_s = reply_timeout_s
        self.by_id = PointIndex()

    async def execute(
        self, args: Args, *, extra_timeout_s: float = 0.0
    ) -> Mapping[str, Any]:
        """Execute any command; return its result.

        Args:
            args: of the command.
            extra_timeout_s: added to the usual time-out.
        """
        valid_s = self._reply_timeout_s
        return await self._requests.result(args, valid_s + extra_timeout_s, valid_s)

    async def capture(
        self, samples: int | None = None, dwell_s: float | None = None
    ) -> Point:
        """Take a point; it is stored on the arm's disk when this returns.

        Args:
            samples: number of samples to average; or
            dwell_s: duration of samples to average.
        """
        values = {"samples": samples, "dwell_s": dwell_s}
        args = PointArgs.model_validate({k: v for k, v in values.items() if v})
        longest_s = dwell_s or (MEAN_S if (samples or 1) > 1 else 0.0)
        return await self._point(await self.execute(args, extra_timeout_s=longest_s))

    async def undo(self, point_id: str | None = None) -> Point:
        """Retract the last point; return the retraction, which is a point too.

        Args:
            point_id: if given, it must be that point.
        """
        args = UndoArgs() if point_id is None else UndoArgs(id=point_id)
        return await self._point(await self.execute(args))

    async def label(
        self, artefact: str | None = None, feature: str | None = None
    ) -> None:
        """Set the label of the next points; without arguments: none."""
        await self.execute(LabelArgs(artefact=artefact, feature=feature))

    async def probe(self, name: str) -> str:
        """Change the probe; return the digest of the arm with it."""
        return str((await self.execute(ProbeArgs(name=name)))["model"])

    async def confirm_reference(
        self,
        at_xyz_mm: Vector | None = None,
        tolerance_mm: float = 1.0,
        *,
        utc: bool = False,
    ) -> list[str]:
        """Accept the positions of the encoders, after a loss of power.

        Args:
            at_xyz_mm: the probe's known position, in the arm's system; refused if the
                measured one differs by more than
            tolerance_mm: this.
            utc: accept the UTC of the daemon's computer, and no positions.

        Returns:
            A sentence on each device that was in doubt and is accepted.
        """
        args = ReferenceArgs(
            action="confirm", at_xyz_mm=at_xyz_mm, tolerance_mm=tolerance_mm, utc=utc
        )
        return list((await self.execute(args))["accepted"])

    async def home(self, joints: Sequence[str] | None = None) -> list[str]:
        """Set the counts: the arm is in the home posture of its file.

        Args:
            joints: names of those concerned; None for all with incremental encoders.

        Returns:
            The joints that have been homed.
        """
        args = HomeArgs(joints=None if joints is None else tuple(joints))
        return list((await self.execute(args))["homed"])

    async def reload(self) -> str:
        """Reload arm file and configuration; return the arm's digest."""
        return str((await self.execute(ReloadArgs()))["model"])

    async def align(
        self,
        rotation: Iterable[Iterable[float]],
        translation_mm: Iterable[float],
        *,
        scale: float = 1.0,
        name: str | None = None,
    ) -> None:
        """Add part coordinates to points: scale * rotation * arm + translation_mm.

        Args:
            rotation: its three rows.
            translation_mm: the arm's origin in the part's system.
            scale: of the part's system against the arm's.
            name: of the alignment.
        """
        first, second, third = (_vector(row) for row in rotation)
        args = AlignArgs(
            action="set",
            name=name,
            rotation=(first, second, third),
            translation_mm=_vector(translation_mm),
            scale=float(scale),
        )
        await self.execute(args)

    async def clear_alignment(self) -> None:
        await self.execute(AlignArgs(action="clear"))

    async def new_session(self, note: str | None = None) -> str:
        """Start a new session, numbered from 0; return it."""
        args = SessionArgs(action="new", note=note)
        return str((await self.execute(args))["session"])

    async def start_scan(
        self, mode: ScanMode = "time", **options: Unpack[ScanOptions]
    ) -> StartedScan:
        """Start a scan; it replaces a running one."""
        normal = options.get("normal")
        values = {**options, "normal": None if normal is None else _vector(normal)}
        args = ScanArgs.model_validate({"action": "start", "mode": mode, **values})
        return StartedScan.read(await self.execute(args))

    async def stop_scan(self) -> None:
        """End the running scan, if there is one."""
        await self.execute(ScanArgs(action="stop"))

    async def covariance(self, points: Iterable[Point | str]) -> "JointCovariance":
        """Return the joint covariance of points, or of their ids.

        At most 100 of the latest 1000 of the arm, all measured with one probe; it
        includes the arm's parameters if the arm file has a covariance (`with_arm`).
        """
        ids = tuple(point if isinstance(point, str) else point.id for point in points)
        result = await self.execute(CovarianceArgs(ids=ids))
        return PointCovariances.read(result).joint()

    async def shared_errors(self, samples: Sequence[Point]) -> Floats:
        """Return what samples share by the arm's parameters, from their angles.

        At most 100, measured with the probe in use; need not be points of the arm.

        Returns:
            Factors S as of `JointCovariance`, (n, 3, rank).
        """
        readings = tuple(
            Reading(angles_rad=sample.angles_rad, utc_s=sample.time_ns * 1e-9)
            for sample in samples
        )
        args = CovarianceArgs(model=samples[0].model, readings=readings)
        result = SharedErrors.read(await self.execute(args))
        return np.array(result.shared_mm)

    async def distance(self, first: Point | str, second: Point | str) -> "Length":
        """Return the length between two points with its uncertainty.

        Errors of the arm that both points share are taken into account; see
        `covariance` for the points allowed.
        """
        return (await self.covariance((first, second))).length(0, 1)

    async def sessions(self) -> tuple[StoredSession, ...]:
        """List sessions in the arm's outbox, oldest first."""
        return StoredSession.read_all(await self.execute(ResendArgs()))

    async def resend(
        self, session: str, from_seq: int = 0, to_seq: int | None = None
    ) -> Resent:
        """Request points again, for all followers of the arm.

        Missed points are requested automatically: `points` needs no help.
        """
        args = ResendArgs(session=session, from_seq=from_seq, to_seq=to_seq)
        return Resent.read(await self.execute(args))

    async def resend_scan(
        self, scan: str, from_seq: int = 0, to_seq: int | None = None
    ) -> ResentScan:
        """Request blocks of a scan again, for all followers of the arm's scans.

        The arm has them if its configuration delivers scans completely.
        """
        args = ResendArgs(scan=scan, from_seq=from_seq, to_seq=to_seq)
        return ResentScan.read(await self.execute(args))

    async def _point(self, result: Mapping[str, Any]) -> Point:
        """The point named in an answer; requested again where it does not arrive."""
        captured = CapturedPoint.read(result)
        for _ in range(3):
            point = await self.by_id.get(captured.id, ARRIVAL_S)
            if point is not None:
                return point
            await self.resend(captured.session, captured.seq, captured.seq)
        raise NoAnswerError(
            f"point {captured.seq} of session {captured.session} was taken, but it did "
            "not arrive here; it is in the arm's outbox"
        )


def _vector(values: Iterable[float]) -> Vector:
    """Convert three numbers of any kind, such as a row of an array."""
    x, y, z = (float(value) for value in values)
    return (x, y, z)
