"""Devices that come, go and complain: their state, and the events about it."""

from collections.abc import Callable

from traverse.daemon.acquisition.device import Device
from traverse.daemon.acquisition.joint_devices import JointDevices
from traverse.daemon.acquisition.resampler import Resampler
from traverse.daemon.clock import HostClock
from traverse.daemon.monitoring.events import EventLog
from traverse.daemon.pose.pipeline import Pipeline
from traverse.drivers.base.values import DeviceAlarm, DeviceFault, DeviceLost, DeviceUp


class DeviceStateTracker:
    """Follows what devices say of themselves.

    Args:
        clock: the host's.
        devices: that read the arm's joints.
        pipeline: told where turns are no longer known.
        assembly: told whose readings may be waited for.
        events: where it is all told.
        changed: called when a device's state has changed.
    """

    def __init__(
        self,
        *,
        clock: HostClock,
        devices: JointDevices,
        pipeline: Pipeline,
        assembly: Resampler,
        events: EventLog,
        changed: Callable[[], None],
    ) -> None:
        self._clock = clock
        self._devices = devices
        self._pipeline = pipeline
        self._assembly = assembly
        self._events = events
        self._changed = changed

    def on_up(self, device: Device, up: DeviceUp) -> None:
        """The device answered; it may not be what the arm file says."""
        name = device.section.id
        device.identity = up.identity
        device.up_ns = self._clock.monotonic_ns()
        device.temperatures_c = ()  # those of before may have changed meanwhile
        device.problems = []
        if device in self._devices:
            device.problems = self._pipeline.model.mismatches_with(name, up.identity)
            self._assembly.up(name, up.identity.jitter_ns, restarted=up.restarted)
        for problem in device.problems:
            self._events.report(
                "error",
                "device.mismatch",
                problem,
                source=name,
                remedy="correct the arm file, or set the device up for it",
            )
        device.reconnects += device.state == "lost"
        device.state = "failed" if device.problems else "ready"
        if up.restarted:
            # Its absolute encoders go on; where the turns are counted is a guess.
            self._pipeline.restart(name)
            self._events.report(
                "warning",
                "device.restarted",
                f"{name} has been without power",
                source=name,
                remedy="check a known point before measuring on",
            )
        firmware = f", firmware {up.identity.firmware}" if up.identity.firmware else ""
        self._events.change(
            False,
            "error",
            "device.lost",
            f"{up.identity.name} is there{firmware}",
            source=name,
        )
        device.heard.set()
        self._changed()

    def on_lost(self, device: Device, lost: DeviceLost) -> None:
        """The device is gone."""
        device.lost = lost
        if device in self._devices:
            self._assembly.lost(device.section.id)
        if device.state != "starting":
            device.state = "lost"
            self._events.change(
                True,
                "error",
                "device.lost",
                lost.reason,
                source=device.section.id,
                remedy=lost.remedy,
            )
        device.heard.set()
        self._changed()

    def on_alarm(self, device: Device, alarm: DeviceAlarm) -> None:
        """A condition of the device begins or ends."""
        source = device.section.id
        if alarm.channel is not None:
            source = f"{source}/{alarm.channel}"
        value = f" (value {alarm.value})" if alarm.value else ""
        self._events.change(
            alarm.raised,
            "error",
            f"alarm.{alarm.code}",
            f"{alarm.text}{value}",
            source=source,
            remedy=alarm.remedy,
        )

    def on_fault(self, device: Device, fault: DeviceFault) -> None:
        """Something went wrong that the driver survived."""
        self._events.report(
            "warning",
            f"device.{fault.code}",
            fault.text,
            source=device.section.id,
            remedy=fault.remedy,
            count=fault.count,
        )
