"""What the command `scan` does: start and stop one."""

import asyncio

from traverse.daemon.commands.points import check_ready
from traverse.daemon.config.schema import CaptureSection, ScanSection
from traverse.daemon.errors import RequestRefusedError, Result
from traverse.daemon.executor import StartScan, execute, stop_scan
from traverse.daemon.measurement import Measurement
from traverse.daemon.scans.plan import requested_scan
from traverse.protocol.messages import ScanArgs

STREAM_TIMEOUT_S = 3.0


class Requests:
    """Carries out commands on the devices that read the arm's joints."""

    def __init__(
        self,
        *,
        settings: CaptureSection,
        scan: ScanSection | None = None,
        measurement: Measurement,
    ) -> None:
        self._settings = settings
        self._scan = scan or ScanSection()
        self._measurement = measurement
        self._devices = measurement.joint_devices
        self._scanner = measurement.scanner

    def use(self, settings: CaptureSection, scan: ScanSection) -> None:
        """Go by other settings; a running scan keeps its rate."""
        self._settings, self._scan = settings, scan
        if self._scanner.plan is None:
            self.track()

    def track(self) -> None:
        """Stream at the rate that follows the joints while no scan runs."""
        self._devices.request_stream(self._settings.tracking_rate_hz)

    async def change_scan(self, args: ScanArgs) -> Result:
        """Start a scan, or stop the running one; gives its id."""
        if args.action == "stop":
            plan = self._scanner.plan
            total = stop_scan(self._measurement)
            if plan is not None:
                self.track()
            return {"scan": None if plan is None else plan.id, "total": total}
        check_ready(self._devices)
        if args.held and not any(i.trigger == "button" for i in self._settings.inputs):
            raise RequestRefusedError(
                "scan.no_button",
                "no input of the configuration is a button that could hold a scan",
                'name one in [capture] inputs, with trigger = "button"',
            )
        device = self._measurement.clock_device
        largest_hz = self._settings.scan_max_rate_hz
        tracking_hz = self._settings.tracking_rate_hz
        if device.identity is not None:
            largest_hz = min(largest_hz, device.identity.max_rate_hz)
            tracking_hz = min(tracking_hz, device.identity.max_rate_hz)
        plan = requested_scan(
            args, self._scan, largest_hz=largest_hz, tracking_rate_hz=tracking_hz
        )
        stop_scan(self._measurement)
        execute(self._measurement, StartScan(plan))
        self._devices.request_stream(plan.device_rate_hz)
        try:
            async with asyncio.timeout(STREAM_TIMEOUT_S):
                await self._measurement.scans.stream_started.wait()
        except TimeoutError as error:
            if self._scanner.plan is plan:  # else another command has had its way
                stop_scan(self._measurement)
                self.track()
            raise RequestRefusedError(
                "device.no_answer",
                f"{device.section.id} did not begin to stream within "
                f"{STREAM_TIMEOUT_S:g} s",
                "check the device",
            ) from error
        return {
            "scan": plan.id,
            "rate_hz": plan.rate_hz,
            "device_rate_hz": plan.device_rate_hz,
        }
