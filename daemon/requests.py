"""What the commands do: take a point, start and stop a scan."""

import asyncio

from daemon.arm_devices import ArmDevices
from daemon.arm_points import Answer, CaptureRefusedError
from daemon.capture import Capture
from daemon.commands import CommandError, Result
from daemon.configuration import CaptureSection
from daemon.device import Device
from daemon.measuring import Measuring
from daemon.model import ArmModel
from daemon.scanner import Scanner, plan_scan
from drivers.values import DeviceError
from protocol.messages import Point, PointArgs, ScanArgs

LATCH_S = 2.0
STREAM_S = 3.0
DEFAULT_RATE_HZ = 100.0


class Requests:
    """Carries out commands on the devices that read the arm's joints."""

    def __init__(
        self,
        *,
        settings: CaptureSection,
        model: ArmModel,
        devices: ArmDevices,
        capture: Capture,
        scanner: Scanner,
        measuring: Measuring,
    ) -> None:
        self._settings = settings
        self._model = model
        self._devices = devices
        self._capture = capture
        self._scanner = scanner
        self._measuring = measuring

    def track(self) -> None:
        """Stream at the rate that follows the joints while no scan runs."""
        self._devices.request_stream(self._settings.tracking_rate_hz)

    async def take_point(self, args: PointArgs) -> Result:
        """Latch now and capture; gives session, seq and id of the point."""
        if (args.samples or 1) > 1 or args.dwell_s is not None:
            raise CommandError(
                "command.not_available",
                "this version takes single samples, not averages",
                "leave samples and dwell_s out",
            )
        self._check_ready()
        if self._devices.latch_together:
            point = await self._latched_point(self._devices.all[0])
        else:
            point = await self._carried_out(self._measuring.points.take_now())
        return {"session": point.session, "seq": point.seq, "id": point.id}

    async def _latched_point(self, device: Device) -> Point:
        """A point of what a device latches now."""
        waiting: Answer = asyncio.get_running_loop().create_future()
        try:
            token = device.driver.request_latch()
        except DeviceError as error:
            raise CommandError("device.busy", str(error), error.remedy) from error
        self._measuring.latches[token] = waiting
        try:
            async with asyncio.timeout(LATCH_S):
                return await self._carried_out(waiting)
        except TimeoutError as error:
            raise CommandError(
                "device.no_answer",
                f"{device.section.id} did not latch within {LATCH_S:g} s",
                "check the device",
            ) from error
        finally:
            self._measuring.latches.pop(token, None)

    async def _carried_out(self, answer: Answer) -> Point:
        try:
            return await answer
        except CaptureRefusedError as error:
            raise CommandError("capture.refused", str(error), error.remedy) from error

    async def change_scan(self, args: ScanArgs) -> Result:
        """Start a scan, or stop the running one; gives its id."""
        if args.action == "stop":
            plan = self._scanner.plan
            total = self._scanner.stop()
            if plan is not None:
                self.track()
            return {"scan": None if plan is None else plan.id, "total": total}
        if args.mode != "time" or args.held:
            raise CommandError(
                "command.not_available",
                f"this version scans by time only, not by {args.mode!r} or held",
                'use mode "time"',
            )
        self._check_ready()
        device = self._measuring.clock_device
        largest_hz = self._settings.scan_max_rate_hz
        tracking_hz = self._settings.tracking_rate_hz
        if device.identity is not None:
            largest_hz = min(largest_hz, device.identity.max_rate_hz)
            tracking_hz = min(tracking_hz, device.identity.max_rate_hz)
        plan = plan_scan(args.rate_hz or DEFAULT_RATE_HZ, tracking_hz)
        if plan.device_rate_hz > largest_hz:
            raise CommandError(
                "scan.rate",
                f"{plan.rate_hz:g} Hz is more than the {largest_hz:g} Hz possible",
                "ask for a lower rate",
            )
        self._scanner.stop()
        self._measuring.stream_started.clear()
        self._scanner.start(plan, self._model, self._capture.session.id)
        self._devices.request_stream(plan.device_rate_hz)
        try:
            async with asyncio.timeout(STREAM_S):
                await self._measuring.stream_started.wait()
        except TimeoutError as error:
            if self._scanner.plan is plan:  # else another command has had its way
                self._scanner.stop()
                self.track()
            raise CommandError(
                "device.no_answer",
                f"{device.section.id} did not begin to stream within {STREAM_S:g} s",
                "check the device",
            ) from error
        return {
            "scan": plan.id,
            "rate_hz": plan.rate_hz,
            "device_rate_hz": plan.device_rate_hz,
        }

    def _check_ready(self) -> None:
        device = self._devices.absent
        if device is not None:
            reason = device.lost.reason if device.lost else "it is not ready"
            raise CommandError(
                "device.lost",
                f"{device.section.id} cannot measure: {reason}",
                "bring the device back, then send the command again as a new request",
            )
