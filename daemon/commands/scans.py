"""The command `scan`, and scans by button."""

import asyncio
from collections.abc import Awaitable, Callable
from typing import Literal

from traverse.daemon.command_handlers import handles
from traverse.daemon.commands.points import check_ready
from traverse.daemon.errors import RequestRefusedError, Result
from traverse.daemon.executor import StartScan, stop_scan
from traverse.daemon.measurement import Measurement
from traverse.daemon.monitoring.events import EventLog
from traverse.daemon.scans.plan import requested_scan
from traverse.protocol.messages import ScanArgs

STREAM_TIMEOUT_S = 3.0
MAX_WAITING_ACTIONS = 64


class ScanCommands:
    """Executes scan commands on the devices that read the joints."""

    def __init__(self, measurement: Measurement) -> None:
        self._measurement = measurement
        self._devices = measurement.joint_devices
        self._scanner = measurement.scanner

    def request_tracking_rate(self) -> None:
        """Request the rate that follows the joints, unless a scan runs."""
        if not self._scanner.is_running:
            capture = self._measurement.configuration.capture
            self._devices.request_stream(capture.tracking_rate_hz)

    @handles(ScanArgs)
    async def change_scan(self, args: ScanArgs) -> Result:
        """Start a scan, or stop the running one; return its id."""
        if args.action == "stop":
            plan = self._scanner.plan
            total = stop_scan(self._measurement)
            if plan is not None:
                self.request_tracking_rate()
            return {"scan": None if plan is None else plan.id, "total": total}
        check_ready(self._devices)
        configuration = self._measurement.configuration
        settings = configuration.capture
        if args.held and not any(i.trigger == "button" for i in settings.inputs):
            raise RequestRefusedError(
                "scan.no_button",
                "no input of the configuration is a button that could hold a scan",
                'name one in [capture] inputs, with trigger = "button"',
            )
        device = self._measurement.clock_device
        largest_hz = settings.scan_max_rate_hz
        tracking_hz = settings.tracking_rate_hz
        if device.identity is not None:
            largest_hz = min(largest_hz, device.identity.max_rate_hz)
            tracking_hz = min(tracking_hz, device.identity.max_rate_hz)
        plan = requested_scan(
            args,
            configuration.scan,
            largest_hz=largest_hz,
            tracking_rate_hz=tracking_hz,
            reads_in_turn=device.identity is not None and device.identity.reads_in_turn,
        )
        stop_scan(self._measurement)
        StartScan(plan).execute(self._measurement)
        # The others are interpolated at its instants, however often they are read.
        others_hz = max(plan.device_rate_hz, settings.tracking_rate_hz)
        self._devices.request_stream(plan.device_rate_hz, device, others_hz)
        try:
            async with asyncio.timeout(STREAM_TIMEOUT_S):
                await self._scanner.stream_started.wait()
        except TimeoutError as error:
            if self._scanner.plan is plan:  # else another command has had its way
                stop_scan(self._measurement)
                self.request_tracking_rate()
            raise RequestRefusedError(
                "device.no_answer",
                f"{device.section.id} did not begin to stream within "
                f"{STREAM_TIMEOUT_S:g} s",
                "check the device",
            ) from error
        running = self._scanner.plan
        if running is not None and running.id == plan.id:
            plan = running  # with the rate that the device has
        return {
            "scan": plan.id,
            "rate_hz": plan.rate_hz,
            "device_rate_hz": plan.device_rate_hz,
        }


class ButtonScans:
    """Executes actions of buttons one after the other."""

    def __init__(self, events: EventLog) -> None:
        self._events = events
        self._actions: asyncio.Queue[ScanArgs] = asyncio.Queue(MAX_WAITING_ACTIONS)

    def request(self, action: Literal["start", "stop"]) -> None:
        """Start a timed scan at the configured rate, or stop the running one."""
        try:
            self._actions.put_nowait(ScanArgs(action=action))
        except asyncio.QueueFull:
            self._refuse(
                f"{MAX_WAITING_ACTIONS} presses wait for scans to start and to stop",
                "wait until the last scan has started",
            )

    async def run(self, change_scan: Callable[[ScanArgs], Awaitable[Result]]) -> None:
        while True:
            args = await self._actions.get()
            try:
                await change_scan(args)
            except RequestRefusedError as error:
                self._refuse(str(error), error.remedy)

    def _refuse(self, text: str, remedy: str) -> None:
        self._events.report("error", "scan.refused", text, remedy=remedy)
