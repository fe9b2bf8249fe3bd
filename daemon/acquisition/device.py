"""A configured device: driver, state, identity and clock."""

import asyncio
import contextlib
from collections import Counter
from collections.abc import AsyncIterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

from traverse.daemon.config.devices import DeviceSection
from traverse.drivers.base.delivery_queue import DeliveryQueue
from traverse.drivers.base.driver import Driver
from traverse.drivers.base.registry import driver_class
from traverse.drivers.base.values import DeviceLost, DeviceTemperatures, Identity
from traverse.protocol.messages import DeviceHealth, DriverStatus

DeviceStateName = Literal["starting", "ready", "lost", "failed", "stopped"]


RECENT_NS, RECENT_PERIODS = 1_000_000_000, 20  # without readings: none are recent
BELIEVED_C = (-20.0, 60.0)  # an arm in use; else Fahrenheit, kelvin, or no sensor
REPORT_PERIODS = 5  # without a temperature: the last one is not recent


@dataclass(slots=True, eq=False)
class Device:
    """A device as the service sees it.

    Attributes:
        answered: set once the device has answered, or has been given up at first.
        last_ns: host monotonic time of the last byte; 0 for none.
        up_ns: since when it is connected.
        samples_ns: of its last samples; 0 for never.
        period_ns: of its stream; 0 for none.
        max_speed_rad_s: fastest joint; None if its options do not state one.
        temperatures_c: of its sensors; empty without a recent report.
        temperatures_end_ns: until then they are recent; 0: always.
        sensor: number of the first that has had a believable temperature, which is the
            arm's; one that fails is not replaced by another, of a place elsewhere.
        clock_text: state of its clock, in words; empty before the first report.
        clock_doubt: `clock_text` when the clock was last in doubt.
        has_rate_error: its clock is known to run off its rate.
    """

    section: DeviceSection
    delivery_queue: DeliveryQueue
    driver: Driver
    max_speed_rad_s: float | None = field(init=False)
    state: DeviceStateName = "starting"
    identity: Identity | None = None
    last_loss: DeviceLost | None = None
    problems: list[str] = field(default_factory=list)
    answered: asyncio.Event = field(default_factory=asyncio.Event)
    last_ns: int = 0
    up_ns: int = 0
    samples_ns: int = 0
    period_ns: int = 0
    counters: Counter[str] = field(default_factory=Counter)
    temperatures_c: tuple[float | None, ...] = ()
    temperatures_end_ns: int = 0
    sensor: int | None = None
    clock_text: str = ""
    clock_doubt: str = ""
    has_rate_error: bool = False
    samples: int = 0
    reconnects: int = 0

    def __post_init__(self) -> None:
        self.max_speed_rad_s = getattr(self.section, "max_speed_rad_s", None)

    @property
    def debounce_key(self) -> str:
        """Key of its time of debouncing in the configuration, for people."""
        keys = [k for k in ("debounce_us", "debounce_ms") if hasattr(self.section, k)]
        return keys[0] if keys else "the debounce time"

    def is_recent(self, now_ns: int) -> bool:
        if self.state != "ready" or not self.period_ns:
            return True
        most_ns = max(RECENT_NS, RECENT_PERIODS * self.period_ns)
        return now_ns - max(self.samples_ns, self.up_ns) <= most_ns

    def take_temperatures(self, report: DeviceTemperatures) -> None:
        self.temperatures_c = report.values_c
        for number, value_c in enumerate(report.values_c[: self.sensor]):
            if _is_believed(value_c):
                self.sensor = number
                break
        lasts_ns = REPORT_PERIODS * report.period_ns
        self.temperatures_end_ns = self.last_ns + lasts_ns if lasts_ns else 0

    def drop_old_temperatures(self, now_ns: int) -> None:
        if self.temperatures_end_ns and now_ns > self.temperatures_end_ns:
            self.temperatures_c = ()

    @property
    def temperature_c(self) -> float | None:
        """Temperature of the sensor in use, if it is one that an arm can have."""
        if self.sensor is None or self.sensor >= len(self.temperatures_c):
            return None
        value_c = self.temperatures_c[self.sensor]
        return value_c if _is_believed(value_c) else None

    def status(self) -> DriverStatus:
        identity: dict[str, Any] = {}
        if self.identity is not None:
            identity = {"name": self.identity.name, "firmware": self.identity.firmware}
        return DriverStatus(
            id=self.section.id,
            driver=self.section.driver,
            port=self.section.where,
            state=self.state,
            identity=identity,
        )

    def health(
        self, rate_hz: float, now_ns: int, lacks: Mapping[str, int]
    ) -> DeviceHealth:
        """Return figures for the health message, with shortfalls due to this device."""
        return DeviceHealth(
            id=self.section.id,
            state=self.state,
            rate_hz=rate_hz,
            age_s=(now_ns - self.last_ns) * 1e-9 if self.last_ns else None,
            queued=self.delivery_queue.waiting_samples,
            queue_limit=self.delivery_queue.max_samples,
            counters={**self.counters, **lacks},
            temperatures_c={
                str(number): value
                for number, value in enumerate(self.temperatures_c)
                if value is not None
            },
        )


def _is_believed(value_c: float | None) -> bool:
    least_c, most_c = BELIEVED_C
    return value_c is not None and least_c <= value_c <= most_c


def open_device(section: DeviceSection, loop: asyncio.AbstractEventLoop) -> Device:
    """Create a configured device; its driver is not started."""
    delivery_queue = DeliveryQueue(loop)
    driver = driver_class(section.driver)(section.id, section.options, delivery_queue)
    return Device(section, delivery_queue, driver)


@contextlib.asynccontextmanager
async def running_drivers(devices: Sequence[Device]) -> AsyncIterator[None]:
    try:
        for device in devices:
            device.driver.start()
        yield
    finally:
        closing = (asyncio.to_thread(device.driver.close) for device in devices)
        await asyncio.gather(*closing)
