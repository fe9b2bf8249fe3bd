"""The measuring part of the daemon on one board, without ports and broker."""

import asyncio

from tests.daemon.values import MODULI, SetClock, kept_at_once
from traverse.daemon.acquisition.device import open_device
from traverse.daemon.acquisition.joint_devices import JointDevices
from traverse.daemon.config.devices import section_of
from traverse.daemon.config.schema import AssemblySection, UncertaintySection
from traverse.daemon.delivery_dispatcher import Measuring
from traverse.daemon.health import HealthReport
from traverse.daemon.monitoring.events import EventLog
from traverse.daemon.points.capture import Capture, TriggerMap
from traverse.daemon.pose.alignment import ActiveAlignment
from traverse.daemon.pose.live import LivePoseSampler
from traverse.daemon.pose.pipeline import Pipeline
from traverse.daemon.pose.uncertainty import CovarianceEvaluator
from traverse.daemon.scans.scanner import Scanner
from traverse.drivers.base.values import Identity

BOARD = Identity("latch board 07", "1.2.3", MODULI, 2, 10_000.0)
OTHER_BOARD = Identity("latch board 08", "1.2.3", MODULI[:1], 2, 10_000.0)


class Bench:
    """The measuring part of the daemon without ports and broker."""

    def __init__(self, model) -> None:
        self.clock = SetClock()
        self.model, self.room = model, True
        self.points, self.events, self.live, self.scans = [], [], [], []
        self.changes = 0
        self.health = HealthReport(self.clock)
        self.part = ActiveAlignment()
        self.scanner = Scanner(
            self.clock,
            lambda scan: not self.scans.append(scan),
            0.05,
            part=self.part,
        )
        self.device = self.open("base")
        self.measuring = Measuring(
            clock=self.clock,
            devices=JointDevices(model, [self.device]),
            settings=AssemblySection(),
            uncertainty=CovarianceEvaluator(UncertaintySection()),
            pipeline=Pipeline(model, self.clock),
            capture=Capture(self.clock, kept_at_once(self.offer), self.part),
            triggers=TriggerMap({("base", 0): "button", ("base", 1): "switch"}),
            scanner=self.scanner,
            live=LivePoseSampler(self.clock, 20.0, self.part),
            events=EventLog(self.clock, self.events.append),
            health=self.health,
            offer_live=self.live.append,
            status_changed=self.count_change,
        )

    def open(self, name):
        section = section_of({"id": name, "driver": "latch-board", "port": "/dev/null"})
        return open_device(section, asyncio.get_running_loop())

    def offer(self, point):
        if self.room:
            self.points.append(point)
        return self.room

    def count_change(self):
        self.changes += 1

    def take(self, *deliveries, device=None):
        for delivery in deliveries:
            self.measuring.take(device or self.device, delivery)

    def codes(self):
        return [event.code for event in self.events]
