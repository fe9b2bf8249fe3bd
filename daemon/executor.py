"""Commands of the measurement as values, executed by the service and by a replay.

`MeasurementCommand.execute` notifies the listener first, so that a recording holds
every command. A command class states how it is recorded and is found by its recorded
name, so that a replay knows every live command.
"""

import asyncio
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from typing import Any, ClassVar, Generic, Self, TypeVar

import numpy as np
from pydantic import BaseModel

from traverse.daemon.current_request import CURRENT_REQUEST
from traverse.daemon.errors import CaptureRefusedError
from traverse.daemon.measurement import Measurement
from traverse.daemon.points.averaging import AverageLimits, SampleAverage
from traverse.daemon.points.controller import PointFuture
from traverse.daemon.pose.alignment import requested_alignment
from traverse.daemon.pose.arm_model import ArmModel
from traverse.daemon.pose.probe_library import LibraryProbe
from traverse.daemon.scans.plan import ScanPlan
from traverse.daemon.store.records import PendingPoint
from traverse.protocol.messages import AlignArgs, HomeArgs, Label, ReferenceArgs

T = TypeVar("T")
T_co = TypeVar("T_co", covariant=True)
REFERENCE_REFUSED = "reference.refused"
HOME_REFUSED = "home.refused"
REST_MM_S = 5.0  # the ball of an arm that rests in its home posture is slower


class MeasurementCommand(ABC, Generic[T_co]):
    """Base of all commands; subclasses are frozen dataclasses.

    Attributes:
        recorded_name: in recordings, and the key in `classes`.
        inner: the one field that is recorded by its own values, and its class.
    """

    recorded_name: ClassVar[str]
    inner: ClassVar[tuple[str, Callable[..., Any]] | None] = None
    classes: ClassVar[dict[str, "type[MeasurementCommand[Any]]"]] = {}

    def __init_subclass__(cls, *, recorded_name: str = "") -> None:
        if recorded_name:
            cls.recorded_name = recorded_name
            MeasurementCommand.classes[recorded_name] = cls

    def to_record(self) -> dict[str, Any]:
        if self.inner is None:
            return dict(vars(self))
        value = getattr(self, self.inner[0])
        return value.model_dump() if isinstance(value, BaseModel) else asdict(value)

    @classmethod
    def from_record(cls, values: Mapping[str, Any]) -> Self:
        if cls.inner is None:
            return cls(**values)
        name, kind = cls.inner
        return cls(**{name: kind(**values)})

    def execute(self, measurement: Measurement) -> T_co:
        measurement.evaluate_readings()
        now_ns = measurement.clock.step()
        record = self.to_record()
        measurement.listener.asked(now_ns, self.recorded_name, record, measurement)
        measurement.quality.check_clock()
        return self._apply(measurement, now_ns)

    @abstractmethod
    def _apply(self, measurement: Measurement, now_ns: int) -> T_co:
        """Execute it at an instant."""


class OrderedCommand(MeasurementCommand["asyncio.Future[Any]"]):
    """Base of commands that take effect after all points requested before."""

    def _apply(self, measurement: Measurement, now_ns: int) -> "asyncio.Future[Any]":
        return measurement.points.in_order(lambda: self._act(measurement, now_ns))

    @abstractmethod
    def _act(self, measurement: Measurement, now_ns: int) -> object:
        """Execute it in its turn."""


def recorded_command(name: str, values: Mapping[str, Any]) -> MeasurementCommand[Any]:
    """Create the command of a recording.

    Raises:
        KeyError: unknown name.
        TypeError: unexpected values.
    """
    return MeasurementCommand.classes[name].from_record(values)


def stop_scan(measurement: Measurement) -> int:
    return StopScan().execute(measurement) if measurement.scanner.is_running else 0


# -- points ---------------------------------------------------------------------------


@dataclass(frozen=True)
class TakeNow(MeasurementCommand[PointFuture], recorded_name="take_now"):
    """Take a point of the stream at this instant."""

    def _apply(self, measurement: Measurement, now_ns: int) -> PointFuture:
        return measurement.points.take_now()


@dataclass(frozen=True)
class TakeMean(MeasurementCommand[PointFuture], recorded_name="take_mean"):
    """Take a point that is the mean of the following samples."""

    samples: int | None
    dwell_ns: int | None
    speed_mm_s: float
    spread_mm: float

    def _apply(self, measurement: Measurement, now_ns: int) -> PointFuture:
        limits = AverageLimits(self.speed_mm_s, self.spread_mm)
        average = SampleAverage(now_ns, self.samples, self.dwell_ns, limits)
        return measurement.points.take_mean(average)


@dataclass(frozen=True)
class AwaitLatch(MeasurementCommand[PointFuture], recorded_name="await_latch"):
    """Take a point of the latch with this token."""

    token: int

    def _apply(self, measurement: Measurement, now_ns: int) -> PointFuture:
        answer: PointFuture = asyncio.get_running_loop().create_future()
        measurement.latches[self.token] = answer, CURRENT_REQUEST.get()
        measurement.latch_points[self.token] = answer

        def forget(answer: PointFuture) -> None:
            if measurement.latch_points.get(self.token) is answer:
                del measurement.latch_points[self.token]

        answer.add_done_callback(forget)
        return answer


@dataclass(frozen=True)
class GiveUpLatch(MeasurementCommand[None], recorded_name="give_up_latch"):
    """Discard the latch with this token; its requester has given up."""

    token: int

    def _apply(self, measurement: Measurement, now_ns: int) -> None:
        measurement.latches.pop(self.token, None)
        answer = measurement.latch_points.pop(self.token, None)
        if answer is not None:
            answer.cancel()


@dataclass(frozen=True)
class Undo(OrderedCommand, recorded_name="undo"):
    """Retract the last point; with an id only that one."""

    id: str | None

    def _act(self, measurement: Measurement, now_ns: int) -> PendingPoint:
        return measurement.capture.undo("command", self.id)


@dataclass(frozen=True)
class SetLabel(OrderedCommand, recorded_name="label"):
    """Label points requested after it."""

    artefact: str | None
    feature: str | None

    def _act(self, measurement: Measurement, now_ns: int) -> Label:
        label = Label(artefact=self.artefact, feature=self.feature)
        measurement.capture.label = label
        words = [word for word in (self.artefact, self.feature) if word is not None]
        text = f"points are taken on {', '.join(words)}" if words else "no label"
        fields = label.model_dump(exclude_none=True)
        measurement.points.report("capture.label", text, fields)
        measurement.sinks.status_changed()
        return label


@dataclass(frozen=True)
class NewSession(OrderedCommand, recorded_name="session"):
    """Begin a session; returns its id."""

    note: str

    def _act(self, measurement: Measurement, now_ns: int) -> str:
        session = measurement.points.begin_session(self.note)
        measurement.sinks.status_changed()
        return session.id


# -- scans ----------------------------------------------------------------------------


@dataclass(frozen=True)
class StartScan(MeasurementCommand[None], recorded_name="start_scan"):
    """Start a scan; none must be running."""

    inner = "plan", ScanPlan
    plan: ScanPlan

    def _apply(self, measurement: Measurement, now_ns: int) -> None:
        session = measurement.capture.session.id
        measurement.scanner.start(self.plan, measurement.model, session)


@dataclass(frozen=True)
class StopScan(MeasurementCommand[int], recorded_name="stop_scan"):
    """Stop the running scan; returns its number of points."""

    def _apply(self, measurement: Measurement, now_ns: int) -> int:
        return measurement.scanner.stop()


# -- alignment and probe --------------------------------------------------------------


@dataclass(frozen=True)
class SetAlignment(OrderedCommand, recorded_name="align"):
    """Set or clear the alignment of points requested after it."""

    inner = "args", AlignArgs
    args: AlignArgs

    def _act(self, measurement: Measurement, now_ns: int) -> bool:
        alignment = requested_alignment(self.args)
        measurement.alignment.alignment = alignment
        text = (
            "no alignment: points have no part coordinates"
            if alignment is None
            else f"alignment {alignment.name or 'without a name'} is in use"
        )
        measurement.points.report("capture.alignment", text)
        measurement.sinks.status_changed()
        return True


@dataclass(frozen=True)
class SetProbe(OrderedCommand, recorded_name="probe"):
    """Measure with a probe of the library; returns the arm with it."""

    probe: LibraryProbe

    def to_record(self) -> dict[str, Any]:
        return {"probe": self.probe.model_dump_json()}

    @classmethod
    def from_record(cls, values: Mapping[str, Any]) -> Self:
        return cls(LibraryProbe.model_validate_json(values["probe"]))

    def _act(self, measurement: Measurement, now_ns: int) -> ArmModel:
        probe = self.probe
        # On the arm as it is by then; it may have been reloaded.
        try:
            measurement.set_probe(probe)
        except ValueError as error:
            raise CaptureRefusedError(
                f"the arm cannot measure with {probe.name!r}: {error}",
                "correct the probe library",
            ) from error
        model = measurement.model
        text = f"probe {probe.name}, radius {model.probe_radius_mm:g} mm, model "
        fields = {"probe": probe.name}
        measurement.points.report("capture.probe", text + model.digest[:12], fields)
        measurement.sinks.status_changed()
        return model


@dataclass(frozen=True)
class JudgeUtc(MeasurementCommand[None], recorded_name="utc"):
    """Doubt the computer's UTC for a reason, or, without one, trust it."""

    doubt: str
    remedy: str

    def _apply(self, measurement: Measurement, now_ns: int) -> None:
        del now_ns
        measurement.judge_utc(self.doubt, self.remedy)


@dataclass(frozen=True)
class ConfirmReference(OrderedCommand, recorded_name="reference"):
    """Accept devices and encoder positions; returns what was in doubt."""

    inner = "args", ReferenceArgs
    args: ReferenceArgs

    def _act(self, measurement: Measurement, now_ns: int) -> dict[str, str]:
        args = self.args
        if args.at_xyz_mm is not None:
            probe_mm = measurement.trajectory.position_mm(now_ns)
            if probe_mm is None:
                raise CaptureRefusedError(
                    "nothing is known of where the probe is",
                    "wait until the arm reports its position",
                    REFERENCE_REFUSED,
                )
            off_mm = float(np.linalg.norm(probe_mm - args.at_xyz_mm))
            if off_mm > args.tolerance_mm:
                raise CaptureRefusedError(
                    f"the probe is {off_mm:.3f} mm from the known point; "
                    f"{args.tolerance_mm:g} mm are allowed",
                    "bring the arm to its reference as its maker says, touch the "
                    "point again, and confirm again",
                    REFERENCE_REFUSED,
                )
        accepted = measurement.references.confirm()
        _report_accepted(measurement, accepted)
        return accepted


@dataclass(frozen=True)
class HomeJoints(OrderedCommand, recorded_name="home"):
    """Take the present posture of joints as the arm file's home posture."""

    inner = "args", HomeArgs
    args: HomeArgs

    def _act(self, measurement: Measurement, now_ns: int) -> dict[str, object]:
        angles_rad = self._angles_rad(measurement)
        speed_mm_s = measurement.trajectory.speed_mm_s(now_ns)
        if speed_mm_s is not None and speed_mm_s > REST_MM_S:
            raise CaptureRefusedError(
                f"the arm moves at {speed_mm_s:.3g} mm/s; at the home posture it rests",
                "put it into its home posture, let it rest, and home again",
                HOME_REFUSED,
            )
        offsets_rad = measurement.pipeline.offsets_for(angles_rad)
        if offsets_rad is None:
            raise CaptureRefusedError(
                "a joint has not been read yet",
                "wait until the arm reports its position",
                HOME_REFUSED,
            )
        accepted = measurement.references.home(offsets_rad)
        measurement.trajectory.forget()  # the readings are others from now on
        measurement.points.arm_changed()
        _report_accepted(measurement, accepted)
        return {"homed": list(offsets_rad), "accepted": accepted}

    def _angles_rad(self, measurement: Measurement) -> dict[str, float]:
        home = measurement.model.arm.home
        if home is None:
            raise CaptureRefusedError(
                "the arm file has no home posture",
                "write [home] with angles_rad into it, or confirm at a known point",
                HOME_REFUSED,
            )
        known = dict(home.angles_rad)
        incremental = measurement.references.devices.incremental_joints
        joints = self.args.joints or tuple(j for j in known if j in incremental)
        for joint in joints:
            if joint not in known:
                text = f"the home posture has no angle of {joint!r}; it has: "
                raise CaptureRefusedError(
                    text + ", ".join(known), "correct [home] or the name", HOME_REFUSED
                )
            if joint not in incremental:
                raise CaptureRefusedError(
                    f"the encoder of {joint} is absolute, its zero is not set by hand",
                    "home the others; if it is not absolute, write absolute = false "
                    "in its [joints.encoder]",
                    HOME_REFUSED,
                )
        if not joints:
            raise CaptureRefusedError(
                "no joint of the home posture has an incremental encoder",
                "confirm the reference instead",
                HOME_REFUSED,
            )
        return {joint: known[joint] for joint in joints}


def _report_accepted(measurement: Measurement, accepted: Mapping[str, str]) -> None:
    for text in accepted.values():
        measurement.points.report("reference.confirmed", text)
    measurement.sinks.status_changed()
