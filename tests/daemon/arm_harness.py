"""What measures in the daemon, with an arm on two devices and a third for buttons."""

import asyncio

from tests.daemon.two_devices import BEGIN_NS, base, model_on_two, wrist
from tests.daemon.values import SetClock, configuration, kept_at_once
from tests.established import confirmed
from traverse.daemon.acquisition.device import Device
from traverse.daemon.commands.points import PointCommands
from traverse.daemon.config.schema import AssemblySection, UncertaintySection
from traverse.daemon.measurement import Measurement, Sinks
from traverse.daemon.monitoring.events import EventLog
from traverse.drivers.base.delivery_queue import DeliveryQueue
from traverse.drivers.base.driver import Driver, DriverOptions
from traverse.drivers.base.values import (
    DeviceUp,
    Identity,
    LatchedCounts,
    StreamStarted,
)

IDENTITIES = {
    "base": Identity("board 1", "1", (1 << 20, 1 << 23, 1 << 16), 2, 1000.0, boot="1"),
    "wrist": Identity(
        "line 2",
        "",
        (1 << 23, 1 << 23),
        0,
        80.0,
        latches=False,
        absolute=True,
        serials=("B1", "B2"),
    ),
    "handle": Identity("foot pedal", "", (), 2, 0.0, latches=False),
}
INPUTS = {"handle/0": "button", "base/0": "switch"}
RATES_HZ = {"base": 100.0, "wrist": 80.0}


class DeafDriver(Driver):
    """A driver whose device a test plays; records its calls."""

    def __init__(self, device, delivery_queue):
        super().__init__(device, DriverOptions(), delivery_queue)
        self.rates_hz: list[float] = []
        self.acknowledged: list[int] = []

    def request_stream(self, rate_hz):
        self.rates_hz.append(rate_hz)

    def acknowledge(self, token):
        self.acknowledged.append(token)

    def _connect(self):
        pass

    def _serve(self):
        pass

    def _disconnect(self):
        pass


class ArmBench:
    def __init__(self, folder, model=None, uncertainty=None, capture=None, **assembly):
        self.clock = SetClock()
        self.clock.now_ns = BEGIN_NS
        self.model = model or model_on_two(folder)
        self.points, self.events, self.live, self.scans = [], [], [], []
        self.actions, self.statuses = [], []
        self.room = True
        configured = configuration(
            *IDENTITIES,
            inputs=INPUTS,
            capture=capture,
            assembly=AssemblySection(**assembly),
            uncertainty=uncertainty or UncertaintySection(),
        )
        self.devices = {device.id: self.device(device) for device in configured.device}
        self.measurement = Measurement(
            configured,
            self.model,
            Sinks(
                EventLog(self.clock, self.events.append),
                kept_at_once(self.offer),
                lambda scan, _: not self.scans.append(scan),
                self.live.append,
                self.actions.append,
                self.change_status,
                references=confirmed(self.model, IDENTITIES),
            ),
            self.clock,
            devices=list(self.devices.values()),
        )
        self.capture = self.measurement.capture
        self.scanner = self.measurement.scanner
        self.point_requests = PointCommands(self.measurement)

    def offer(self, point):
        if self.room:
            self.points.append(point)
        return self.room

    def change_status(self):
        model = self.measurement.model.digest
        self.statuses.append((self.capture.session.id, model))

    def device(self, section):
        delivery_queue = DeliveryQueue(asyncio.get_running_loop())
        driver = DeafDriver(section.id, delivery_queue)
        return Device(section, delivery_queue, driver)

    def close(self):
        for device in self.devices.values():
            device.driver.close()

    def up(self, *names, **changes):
        for name in names or IDENTITIES:
            self.take(DeviceUp(name, IDENTITIES[name], changes.get("restarted", False)))
            if name in RATES_HZ:
                self.take(StreamStarted(name, 1, RATES_HZ[name]))

    def take(self, *deliveries):
        for delivery in deliveries:
            self.measurement.dispatch(self.devices[delivery.device], delivery)

    def stream(self, first, end, speed=0.0):
        self.take(
            wrist(rate_hz=100.0, speed=speed).samples(range(first, end)),
            base(speed=speed).samples(range(first, end)),
        )
        self.clock.now_ns = BEGIN_NS + (end - 1) * 10_000_000

    def later(self, seconds):
        self.clock.now_ns += int(seconds * 1e9)
        self.measurement.process_timeouts()

    def codes(self):
        return [event.code for event in self.events]

    def acknowledged(self, name):
        return self.devices[name].driver.acknowledged


def edge(
    device, instant_ns, token=0, *, number=0, active=True, counts=(), time_bound_ns=0
):
    # A tick is a nanosecond, as of the readings in `two_devices`.
    times_ns = (instant_ns,) * 3
    status = (0,) * len(counts)
    return LatchedCounts(
        device, number, active, token, *times_ns, counts, status, time_bound_ns
    )
