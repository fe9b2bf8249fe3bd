"""The measuring part of the daemon on one board, without ports and broker."""

import asyncio

from tests.daemon.values import MODULI, SetClock, configuration, kept_at_once
from tests.established import confirmed
from traverse.daemon.acquisition.device import open_device
from traverse.daemon.clock import FrozenClock
from traverse.daemon.measurement import Measurement, Sinks
from traverse.daemon.monitoring.events import EventLog
from traverse.daemon.monitoring.latencies import latencies_by_name
from traverse.daemon.reports import HealthReporter
from traverse.drivers.base.values import Identity

BOARD = Identity("latch board 07", "1.2.3", MODULI, 2, 10_000.0, boot="1")
OTHER_BOARD = Identity("latch board 08", "1.2.3", MODULI[:1], 2, 10_000.0)
INPUTS = {"base/0": "button", "base/1": "switch"}


class Bench:
    """The measuring part of the daemon without ports and broker.

    With ``frozen`` its time is constant within each step, as in the service.
    """

    def __init__(self, model, *, frozen=False, **sections) -> None:
        self.clock = SetClock()
        self.model, self.room = model, True
        self.points, self.events, self.live, self.scans = [], [], [], []
        self.changes = 0
        latencies = latencies_by_name()
        self.health = HealthReporter(self.clock, latencies)
        self.device = self.open("base")
        self.measurement = Measurement(
            configuration("base", inputs=INPUTS, **sections),
            model,
            Sinks(
                EventLog(self.clock, self.events.append),
                kept_at_once(self.offer),
                lambda scan, _: not self.scans.append(scan),
                self.live.append,
                status_changed=self.count_change,
                latencies=latencies,
                references=confirmed(model, {"base": BOARD}),
            ),
            FrozenClock(self.clock) if frozen else self.clock,
            devices=[self.device],
        )
        self.scanner = self.measurement.scanner

    def open(self, name):
        (section,) = configuration(name).device
        return open_device(section, asyncio.get_running_loop())

    def offer(self, point):
        if self.room:
            self.points.append(point)
        return self.room

    def count_change(self):
        self.changes += 1

    def take(self, *deliveries, device=None):
        for delivery in deliveries:
            self.measurement.dispatch(device or self.device, delivery)

    def codes(self):
        return [event.code for event in self.events]
