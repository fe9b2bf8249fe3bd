"""Commands on points, alignment and probe."""

import asyncio
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from traverse.daemon.acquisition.device import Device
from traverse.daemon.acquisition.joint_devices import JointDevices
from traverse.daemon.command_handlers import handles
from traverse.daemon.errors import CaptureRefusedError, RequestRefusedError, Result
from traverse.daemon.executor import (
    AwaitLatch,
    ConfirmReference,
    GiveUpLatch,
    HomeJoints,
    NewSession,
    SetAlignment,
    SetLabel,
    SetProbe,
    TakeMean,
    TakeNow,
    Undo,
)
from traverse.daemon.measurement import Measurement
from traverse.daemon.points.averaging import MAX_AVERAGING_NS
from traverse.daemon.points.capture import MOST_SHARED
from traverse.daemon.pose.probe_library import (
    LibraryProbe,
    read_probes,
    write_probe_in_use,
)
from traverse.drivers.base.values import DeviceError
from traverse.kinematics.effects.base.block import Block
from traverse.kinematics.uncertainty.arm_covariance import parameter_columns
from traverse.plurals import counted
from traverse.protocol.messages import (
    AlignArgs,
    CovarianceArgs,
    HomeArgs,
    LabelArgs,
    Point,
    PointArgs,
    ProbeArgs,
    ReferenceArgs,
    SessionArgs,
    UndoArgs,
)
from traverse.strict_toml.problems import FileError, system_reason

LATCH_TIMEOUT_S = 2.0
PROBE_REFUSED = "capture.probe_refused"


@dataclass(eq=False)
class PointCommands:
    """Executes commands on points, in order with edges.

    Args:
        probe_library: file of probes; None if the configuration names none.
        confirm_utc: accepts the computer's UTC.
        confirm_unverified_utc: the same of a possible time; says which, if it was in
            doubt.
        probe_in_use: file that keeps the chosen probe over restarts; None: nowhere.
    """

    measurement: Measurement
    probe_library: Path | None = None
    confirm_utc: Callable[[], None] = lambda: None
    confirm_unverified_utc: Callable[[], str] = str
    probe_in_use: Path | None = None

    def __post_init__(self) -> None:
        self._devices = self.measurement.joint_devices

    @handles(PointArgs)
    async def take_point(self, args: PointArgs) -> Result:
        """Capture one sample or a mean; return session, seq and id of the point."""
        check_ready(self._devices)
        if (args.samples or 1) > 1 or args.dwell_s is not None:
            point = await self._mean(args).execute(self.measurement)
        elif self._devices.has_simultaneous_latch:
            point = await self._latched_point(self._devices.devices[0])
        else:
            point = await TakeNow().execute(self.measurement)
        return point_result(point)

    @handles(UndoArgs)
    async def undo(self, args: UndoArgs) -> Result:
        return point_result(await Undo(args.id).execute(self.measurement))

    @handles(LabelArgs)
    async def label(self, args: LabelArgs) -> Result:
        label = await SetLabel(args.artefact, args.feature).execute(self.measurement)
        return {"label": label.model_dump()}

    @handles(SessionArgs)
    async def begin_session(self, args: SessionArgs) -> Result:
        return {"session": await NewSession(args.note or "").execute(self.measurement)}

    @handles(AlignArgs)
    async def align(self, args: AlignArgs) -> Result:
        """Set or clear the alignment and return it.

        Points requested before the command keep their alignment.
        """
        await SetAlignment(args).execute(self.measurement)
        return {"aligned": args.action != "clear", "name": args.name}

    @handles(ReferenceArgs)
    async def confirm_reference(self, args: ReferenceArgs) -> Result:
        """Accept devices and present positions; return what was in doubt."""
        if args.utc:
            self.confirm_utc()
            return {
                "confirmed": ["utc"],
                "accepted": ["the computer's UTC"],
                "remembered": True,
            }
        check_ready(self._devices)
        accepted = await ConfirmReference(args).execute(self.measurement)
        if utc := self.confirm_unverified_utc():
            accepted = {**accepted, "utc": utc}
        remembered = await self._is_remembered()
        return {
            "confirmed": list(accepted),
            "accepted": list(accepted.values()),
            "remembered": remembered,
        }

    @handles(HomeArgs)
    async def home(self, args: HomeArgs) -> Result:
        """Set the counts at the home posture; return joints and what is confirmed."""
        check_ready(self._devices)
        result = await HomeJoints(args).execute(self.measurement)
        accepted = dict(result["accepted"])
        if utc := self.confirm_unverified_utc():
            accepted["utc"] = utc
        remembered = await self._is_remembered()
        return {
            "homed": result["homed"],
            "confirmed": list(accepted),
            "accepted": list(accepted.values()),
            "remembered": remembered,
        }

    async def _is_remembered(self) -> bool:
        """Wait for the write to the disk; return whether it succeeded."""
        writing = self.measurement.references.devices.memory.writing
        if writing is None:
            return False
        try:
            await asyncio.wrap_future(writing)
        except OSError:  # whoever writes has logged it
            return False
        return True

    @handles(ProbeArgs)
    async def change_probe(self, args: ProbeArgs) -> Result:
        """Measure with a probe of the library; return its name and the new model."""
        path = self.probe_library
        if path is None:
            raise RequestRefusedError(
                "command.not_available",
                "the configuration names no probe library",
                "write one, and name it as `probes` in [arm]",
            )
        try:  # anew each time, so that a probe can be added while the daemon runs
            library = await asyncio.to_thread(read_probes, path)
        except FileError as error:
            raise RequestRefusedError(
                PROBE_REFUSED, error.line[:2000], "correct the probe library"
            ) from error
        self.measurement.probes = library.names
        probe = library.named(args.name)
        if probe is None:
            raise RequestRefusedError(
                PROBE_REFUSED,
                f"{path.name} has no probe {args.name!r}; it has: "
                f"{', '.join(library.names)}",
                "use one of these names, or add the probe to the library",
            )
        before = self.measurement.probe
        await self._keep_probe(probe)
        try:
            model = await SetProbe(probe).execute(self.measurement)
        except CaptureRefusedError as error:  # or a fault while the change waited
            await self._keep_probe(before)
            raise RequestRefusedError(
                PROBE_REFUSED, str(error), error.remedy
            ) from error
        return {
            "probe": probe.name,
            "model": model.digest,
            "radius_mm": model.probe_radius_mm,
        }

    async def _keep_probe(self, probe: LibraryProbe | None) -> None:
        if self.probe_in_use is None:
            return
        name = None if probe is None else probe.name
        try:
            await asyncio.to_thread(write_probe_in_use, self.probe_in_use, name)
        except OSError as error:
            raise RequestRefusedError(
                PROBE_REFUSED,
                f"{self.probe_in_use} cannot be written, and after a restart another "
                f"probe would be in use: {system_reason(error)}",
                "correct that, then choose the probe again",
            ) from error

    @handles(CovarianceArgs)
    async def covariance(self, args: CovarianceArgs) -> Result:
        if cause := self.measurement.model.geometry_doubt:
            raise RequestRefusedError(
                "command.not_available",
                f"how far points are off is not known: {cause}",
                "identify the arm, and keep its covariance file beside the arm file",
            )
        if args.readings:
            return self._shared_by_readings(args)
        covariances = [self.measurement.capture.shared.of(name) for name in args.ids]
        known = [covariance for covariance in covariances if covariance is not None]
        if len(known) < len(covariances):
            raise RequestRefusedError(
                "command.not_available",
                f"{args.ids[covariances.index(None)]} is not among the latest "
                f"{counted(MOST_SHARED, 'point')} since the daemon began, or has no "
                "covariance",
                "ask for points that were measured since",
            )
        models = {point.model for point, _ in known}
        if len(models) > 1:
            raise RequestRefusedError(
                "command.bad_args",
                "the points were measured with different arm files or probes",
                "ask for points of one model",
            )
        return {
            "model": models.pop(),
            "with_arm": any(shared.size for _, shared in known),
            "points": [
                {
                    "id": point.id,
                    "xyz_mm": list(point.xyz_mm),
                    "covariance_mm2": list(point.covariance_mm2 or ()),
                    "shared_mm": shared.tolist(),
                }
                for point, shared in known
            ],
        }

    def _shared_by_readings(self, args: CovarianceArgs) -> Result:
        model, devices = self.measurement.model, self._devices
        n_joints = model.encoders.n_joints
        lengths = {len(reading.angles_rad) for reading in args.readings}
        if args.model != model.digest or lengths != {n_joints}:
            raise RequestRefusedError(
                "command.bad_args",
                "the readings are not of the arm file and probe in use, "
                f"{model.digest}, with {counted(n_joints, 'joint')}",
                "choose the probe again that they were measured with",
            )
        at_rest = np.zeros((len(args.readings), n_joints))
        known_c = devices.temperature_c
        block = Block(
            np.array([reading.angles_rad for reading in args.readings]),
            speeds_rad_s=at_rest,
            approaches=at_rest,
            temperature_c=np.full(
                len(at_rest),
                model.reference_temperature_c if known_c is None else known_c,
            ),
            utc_ns=np.array([int(r.utc_s * 1e9) for r in args.readings]),
        )
        by_parameters, _ = parameter_columns(model.geometry, model.effects, block)
        arm = model.covariance
        factor = np.zeros((by_parameters.shape[2], 0)) if arm is None else arm.factor
        return {
            "model": model.digest,
            "with_arm": bool(factor.size),
            "shared_mm": (by_parameters @ factor).tolist(),
        }

    def _mean(self, args: PointArgs) -> TakeMean:
        settings = self.measurement.configuration.capture
        dwell_ns = None if args.dwell_s is None else int(args.dwell_s * 1e9)
        rate_hz = self.measurement.rate_hz
        if (
            args.samples is not None
            and args.samples > rate_hz * MAX_AVERAGING_NS * 1e-9
        ):
            raise RequestRefusedError(
                "command.bad_args",
                f"{counted(args.samples, 'sample', 'take')} longer than "
                f"{MAX_AVERAGING_NS * 1e-9:g} s at the {rate_hz:g} Hz in use",
                "average fewer samples, or while a faster scan runs",
            )
        return TakeMean(
            args.samples,
            dwell_ns,
            settings.average_speed_mm_s,
            settings.average_spread_mm,
        )

    async def _latched_point(self, device: Device) -> Point:
        try:
            token = device.driver.request_latch()
        except DeviceError as error:
            raise RequestRefusedError(
                "device.busy", str(error), error.remedy
            ) from error
        waiting = AwaitLatch(token).execute(self.measurement)
        try:
            await asyncio.wait({waiting}, timeout=LATCH_TIMEOUT_S)
            if token in self.measurement.latches:
                raise RequestRefusedError(
                    "device.no_answer",
                    f"{device.section.id} did not latch within {LATCH_TIMEOUT_S:g} s",
                    "check the device",
                )
            return await waiting  # it may have to wait for its turn
        finally:
            if not waiting.done():
                GiveUpLatch(token).execute(self.measurement)


def point_result(point: Point) -> dict[str, Any]:
    result = {"session": point.session, "seq": point.seq, "id": point.id}
    if point.retracts is not None:
        return result | {"retracts": point.retracts}
    if point.samples > 1:
        result |= {"samples": point.samples, "spread_mm": point.spread_mm}
    return result


def check_ready(devices: JointDevices) -> None:
    """Check that all devices of the arm can measure.

    Raises:
        RequestRefusedError: one cannot.
    """
    device = devices.first_unavailable
    if device is not None:
        reason = device.last_loss.reason if device.last_loss else "it is not ready"
        raise RequestRefusedError(
            "device.lost",
            f"{device.section.id} cannot measure: {reason}",
            "reconnect the device, then send the command again as a new request",
        )
