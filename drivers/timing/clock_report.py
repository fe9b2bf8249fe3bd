"""Reports on the state of a device's clock."""

from collections.abc import Callable

from traverse.drivers.base.values import DeviceClockState
from traverse.drivers.timing.device_clock import DeviceClock

RATE_CHANGE = 1e-4
BOUND_RATIO = 3.0
LEAST_NS = 1_000_000_000  # between two reports, unless certainty changes
LASTING_NS = 200_000_000  # a doubt that is shorter marks what it concerns, no more


class ClockReporter:
    """Reports a clock at first, and on changes.

    Args:
        put: delivers a report; False if there is no room.
    """

    def __init__(self, device: str, put: Callable[[DeviceClockState], bool]) -> None:
        self._device, self._put = device, put
        self._reported: DeviceClockState | None = None
        self._reported_ns = self._certain_ns = 0

    def forget(self) -> None:
        """Report anew: the device is another, or was away."""
        self._reported = None

    def report(self, clock: DeviceClock, now_ns: int) -> None:
        """Report the clock, if there is something new."""
        last_report = self._reported
        is_certain = clock.running and not clock.is_uncertain
        if is_certain:
            self._certain_ns = now_ns
        elif (
            last_report
            and last_report.is_certain
            and now_ns - self._certain_ns < LASTING_NS
        ):
            return
        if last_report is not None and last_report.is_certain == is_certain:
            if now_ns - self._reported_ns < LEAST_NS or not is_certain:
                return
            ratio = (clock.error_bound_ns + 1) / (last_report.bound_ns + 1)
            if (
                abs(clock.rate_error - last_report.rate_error) < RATE_CHANGE
                and 1.0 / BOUND_RATIO < ratio < BOUND_RATIO
                and clock.steps == last_report.steps
            ):
                return
        state = DeviceClockState(
            self._device,
            is_certain,
            clock.rate_error,
            clock.error_bound_ns,
            clock.steps,
        )
        if self._put(state):
            self._reported, self._reported_ns = state, now_ns
