"""What the commands about points do: take one, undo it, label it, begin a session."""

import asyncio
from collections.abc import Callable
from typing import TypeVar

from traverse.daemon.acquisition.device import Device
from traverse.daemon.acquisition.joint_devices import JointDevices
from traverse.daemon.config.schema import CaptureSection
from traverse.daemon.delivery_dispatcher import Measuring
from traverse.daemon.errors import RequestRefusedError, Result
from traverse.daemon.points.averaging import (
    MAX_AVERAGING_NS,
    AverageLimits,
    SampleAverage,
)
from traverse.daemon.points.capture import Capture
from traverse.daemon.points.controller import PointFuture
from traverse.drivers.base.values import DeviceError
from traverse.protocol.messages import (
    Label,
    LabelArgs,
    Point,
    PointArgs,
    SessionArgs,
    UndoArgs,
)

LATCH_TIMEOUT_S = 2.0

T = TypeVar("T")


class PointCommands:
    """Carries out commands that concern points, in order with the edges.

    Args:
        settings: of the configuration.
        devices: that read the arm's joints.
        capture: where points are numbered.
        measuring: where they are taken.
        session_changed: called when a new session has begun.
    """

    def __init__(
        self,
        *,
        settings: CaptureSection,
        devices: JointDevices,
        capture: Capture,
        measuring: Measuring,
        session_changed: Callable[[], None],
    ) -> None:
        self._settings = settings
        self._devices = devices
        self._capture = capture
        self._measuring = measuring
        self._session_changed = session_changed

    def use(self, settings: CaptureSection) -> None:
        """Go by other settings."""
        self._settings = settings

    async def take_point(self, args: PointArgs) -> Result:
        """Capture now, one sample or a mean; gives session, seq and id of the point."""
        check_ready(self._devices)
        if (args.samples or 1) > 1 or args.dwell_s is not None:
            average = self._average(args)
            point = await self._measuring.points.take_mean(average)
        elif self._devices.has_simultaneous_latch:
            point = await self._latched_point(self._devices.devices[0])
        else:
            self._measuring.asked("take_now")
            point = await self._measuring.points.take_now()
        result = {"session": point.session, "seq": point.seq, "id": point.id}
        if point.samples > 1:
            result |= {"samples": point.samples, "spread_mm": point.spread_mm}
        return result

    async def undo(self, args: UndoArgs) -> Result:
        """Take the last point back; gives the retraction and what it retracts."""
        self._measuring.asked("undo", id=args.id)
        retraction: Point = await self._measuring.points.in_order(
            lambda: self._capture.undo("command", args.id)
        )
        return {
            "session": retraction.session,
            "seq": retraction.seq,
            "id": retraction.id,
            "retracts": retraction.retracts,
        }

    async def label(self, args: LabelArgs) -> Result:
        """Say what the next points are taken on."""
        label = Label(artefact=args.artefact, feature=args.feature)

        def set_label() -> Label:
            self._capture.label = label
            self._measuring.points.events.label(label)
            return label

        self._measuring.asked("label", **label.model_dump())
        await self._measuring.points.in_order(set_label)
        return {"label": label.model_dump()}

    async def begin_session(self, args: SessionArgs) -> Result:
        """Number from 0 again; gives the new session."""

        def begin() -> str:
            session = self._capture.begin_session(args.note or "")
            self._measuring.points.events.session(session)
            self._session_changed()
            return session.id

        self._measuring.asked("session", note=args.note or "")
        return {"session": await self._measuring.points.in_order(begin)}

    def _average(self, args: PointArgs) -> SampleAverage:
        settings = self._settings
        dwell_ns = None if args.dwell_s is None else int(args.dwell_s * 1e9)
        rate_hz = self._measuring.rate_hz
        if (
            args.samples is not None
            and args.samples > rate_hz * MAX_AVERAGING_NS * 1e-9
        ):
            raise RequestRefusedError(
                "command.bad_args",
                f"{args.samples} samples take longer than "
                f"{MAX_AVERAGING_NS * 1e-9:g} s at the {rate_hz:g} Hz of now",
                "average fewer samples, or while a faster scan runs",
            )
        speed_mm_s = settings.average_speed_mm_s
        spread_mm = settings.average_spread_mm
        begin_ns = self._measuring.asked(
            "take_mean",
            samples=args.samples,
            dwell_ns=dwell_ns,
            speed_mm_s=speed_mm_s,
            spread_mm=spread_mm,
        )
        limits = AverageLimits(speed_mm_s, spread_mm)
        return SampleAverage(begin_ns, args.samples, dwell_ns, limits)

    async def _latched_point(self, device: Device) -> Point:
        """A point of what a device latches now."""
        waiting: PointFuture = asyncio.get_running_loop().create_future()
        latches = self._measuring.latches
        try:
            token = device.driver.request_latch()
        except DeviceError as error:
            raise RequestRefusedError(
                "device.busy", str(error), error.remedy
            ) from error
        self._measuring.await_latch(token, waiting)
        try:
            await asyncio.wait({waiting}, timeout=LATCH_TIMEOUT_S)
            if token in latches:
                raise RequestRefusedError(
                    "device.no_answer",
                    f"{device.section.id} did not latch within {LATCH_TIMEOUT_S:g} s",
                    "check the device",
                )
            return await waiting  # it may have to wait for its turn
        finally:
            self._measuring.give_up_latch(token, waiting)


def check_ready(devices: JointDevices) -> None:
    """See that all devices of the arm can measure now.

    Raises:
        RequestRefusedError: one cannot.
    """
    device = devices.first_unavailable
    if device is not None:
        reason = device.last_loss.reason if device.last_loss else "it is not ready"
        raise RequestRefusedError(
            "device.lost",
            f"{device.section.id} cannot measure: {reason}",
            "bring the device back, then send the command again as a new request",
        )
