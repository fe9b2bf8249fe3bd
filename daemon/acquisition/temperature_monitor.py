"""Tells when effects of the arm lack the temperature that they need."""

from traverse.daemon.acquisition.joint_devices import JointDevices
from traverse.daemon.clock import HostClock
from traverse.daemon.monitoring.events import EventLog
from traverse.daemon.pose.arm_model import ArmModel

PATIENCE_NS = 5_000_000_000  # boards tell the temperature every 2 s


class TemperatureMonitor:
    """Raises and clears one lasting condition.

    Args:
        clock: the host's.
        events: where it is told.
    """

    def __init__(self, clock: HostClock, events: EventLog) -> None:
        self._clock = clock
        self._events = events

    def look(self, model: ArmModel, devices: JointDevices) -> None:
        """Look at the devices that read the arm; call it with every block."""
        if not model.uses_temperature:
            return
        is_missing = devices.temperature_c is None
        up_ns = max(device.up_ns for device in devices.all)
        if is_missing and self._clock.monotonic_ns() - up_ns < PATIENCE_NS:
            return  # it has just come, its first message is on the way
        names = ", ".join(model.devices)
        missing = (
            f"{names} has no temperature for the arm's effects; the reference of "
            f"{model.reference_temperature_c:g} C is taken instead"
        )
        self._events.change(
            is_missing,
            "error",
            "device.temperature_unknown",
            missing if is_missing else f"{names} tells the temperature again",
            source=model.devices[0],
            remedy="connect the board's sensor, or take the effects that need the "
            "temperature out of the arm file",
        )
