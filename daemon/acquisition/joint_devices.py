"""The devices that read the joints, as one."""

from collections.abc import Sequence

from traverse.daemon.acquisition.device import Device
from traverse.daemon.config.schema import CaptureSection
from traverse.daemon.pose.arm_model import ArmModel
from traverse.drivers.base.delivery_queue import BATCH_WINDOW_NS

WAITING_BATCH_NS = 20_000_000  # longer would noticeably delay points
BLOCKS_AT_REST = 4  # in one: a block costs more than its samples


class JointDevices:
    """The devices that the arm file names."""

    def __init__(self, model: ArmModel, devices: Sequence[Device]) -> None:
        by_id = {device.section.id: device for device in devices}
        self.devices = [by_id[name] for name in model.devices]
        """In the order of the joints."""

    def __contains__(self, device: Device) -> bool:
        return any(device is own_device for own_device in self.devices)

    @property
    def is_single(self) -> bool:
        return len(self.devices) == 1

    @property
    def has_simultaneous_latch(self) -> bool:
        identity = self.devices[0].identity
        return self.is_single and identity is not None and identity.latches

    @property
    def first_mismatched(self) -> Device | None:
        """First device that does not match the arm file."""
        return next((device for device in self.devices if device.problems), None)

    @property
    def first_unavailable(self) -> Device | None:
        return next(
            (device for device in self.devices if device.state != "ready"), None
        )

    @property
    def temperature_c(self) -> float | None:
        """That of the first device with a sensor that has had one."""
        sensed = (device for device in self.devices if device.sensor is not None)
        device = next(sensed, None)
        return None if device is None else device.temperature_c

    def set_batch_window(
        self, settings: CaptureSection, *, may_wait: bool, rests: bool = False
    ) -> None:
        """Set for how long samples are collected before they are passed on.

        They are passed on at once if a consumer or a point waits, and later if the arm
        rests and nothing measures.
        """
        # A little longer, or a block that lacks a sample would wait for as much again.
        gather_s = 1.04 * min(settings.scan_block_s, 1.0 / settings.live_rate_hz)
        window_ns = min(BATCH_WINDOW_NS, int(gather_s * 1e9))
        if may_wait:
            window_ns = min(window_ns, WAITING_BATCH_NS)
        elif rests:
            window_ns *= BLOCKS_AT_REST
        for device in self.devices:
            device.delivery_queue.batch_window_ns = window_ns

    def request_stream(
        self, rate_hz: float, clock: Device | None = None, others_hz: float = 0.0
    ) -> None:
        """Request a stream of each device, as fast as possible without a rate.

        Other devices than the ``clock`` have a rate of their own.
        """
        for device in self.devices:
            asked_hz = rate_hz if clock in (None, device) else others_hz
            fastest_hz = device.identity.max_rate_hz if device.identity else asked_hz
            device.driver.request_stream(min(asked_hz, fastest_hz))
