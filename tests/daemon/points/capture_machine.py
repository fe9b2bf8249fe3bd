import asyncio
import tempfile
import uuid
from collections import defaultdict
from dataclasses import replace
from pathlib import Path

from hypothesis.stateful import RuleBasedStateMachine

from tests.daemon.arm_harness import DeafDriver
from tests.daemon.points.expected_points import (
    HOLD_MS,
    Asked,
    expected_points,
    has_room,
)
from tests.daemon.values import MODULI, SetClock, arm_model, configuration
from tests.established import confirmed
from traverse.daemon.acquisition.device import Device
from traverse.daemon.config.schema import InputSection
from traverse.daemon.measurement import Measurement, Sinks
from traverse.daemon.monitoring.events import EventLog
from traverse.daemon.store.database import MessageDatabase
from traverse.daemon.store.outbox import message_of
from traverse.daemon.store.records import NewMessage, PendingPoint
from traverse.drivers.base.delivery_queue import DeliveryQueue
from traverse.drivers.base.values import (
    DeviceUp,
    Identity,
    LatchedCounts,
    StreamStarted,
)

IDENTITY = Identity("board", "1", MODULI, 4, 10_000.0, boot="1")
MS = 1_000_000
MEMORY = Path("/dev/shm")

CONFIGURATION = configuration(
    "base",
    capture={
        "hold_s": HOLD_MS / 1000,
        "inputs": (
            InputSection(source="base/0", trigger="button"),
            InputSection(source="base/1", trigger="switch"),
            # Its meaning is decided at its release only, or after some time.
            InputSection(source="base/2", trigger="button", hold="undo"),
        ),
    },
)


class CaptureBench(RuleBasedStateMachine):
    """All that measures in the daemon, in a time of its own; a child has the rules."""

    # Power cuts are played by copies: waiting for a real disk would prove nothing.
    folder = tempfile.TemporaryDirectory(dir=MEMORY if MEMORY.is_dir() else None)
    arm = arm_model(Path(folder.name))

    def __init__(self) -> None:
        super().__init__()
        self.loop = asyncio.new_event_loop()
        self.clock = SetClock()
        self.models = [
            replace(self.arm, digest=f"probe-{n}", probe_radius_mm=float(n))
            for n in range(3)
        ]
        self.asked: list[Asked] = []
        self.published, self.scans, self.events = [], [], []
        self.sessions: list[str] = []
        self.answers: list[asyncio.Future] = []
        self.on_the_line = []
        self.down: dict[int, Asked | None] = {}
        self.released_ns = defaultdict[int, int](int)  # long ago
        self.tokens = self.counts = self.samples = self.sample_counts = 0
        self.stream = 1
        self.acknowledged: list[tuple[int, int]] = []  # token, points so far
        self.scan_counts: dict[str, list[int]] = {}
        self.held_scans: set[str] = set()
        self.waiting: list[tuple[PendingPoint, NewMessage]] = []
        self.keepings: dict[int, PendingPoint] = {}
        self.failures = 0
        self.attempts: list[PendingPoint | None] = []
        self.loop.run_until_complete(self._begin())

    async def _begin(self) -> None:
        delivery_queue = DeliveryQueue(asyncio.get_running_loop())
        driver = DeafDriver("base", delivery_queue)
        driver.acknowledge = lambda token: self.acknowledged.append(
            (token, len(self.published))
        )
        self.device = Device(CONFIGURATION.device[0], delivery_queue, driver)
        self.path = Path(self.folder.name) / f"{uuid.uuid4().hex}.db"
        self.store = MessageDatabase(self.path)
        self.measurement = Measurement(
            CONFIGURATION,
            self.models[0],
            Sinks(
                EventLog(self.clock, self.events.append),
                self._keep,
                lambda scan, _: not self.scans.append(scan),
                references=confirmed(self.models[0], {"base": IDENTITY}),
            ),
            self.clock,
            devices=[self.device],
        )
        self.scanner = self.measurement.scanner
        self.capture = self.measurement.capture
        self.capture.undo = self._watched(self.capture.undo)
        self.sessions.append(self.capture.session.id)
        identity = IDENTITY
        self.take(DeviceUp("base", identity, False), StreamStarted("base", 1, 100.0))

    def _watched(self, undo):
        """Record the result of each attempt to retract a point; None: refused."""

        def watched(*arguments):
            self.attempts.append(None)
            self.attempts[-1] = undo(*arguments)
            return self.attempts[-1]

        return watched

    def _keep(self, point, begun_ns, note) -> PendingPoint | None:
        is_undo = point.retracts is not None
        if not has_room(point.counts[0], is_undo=is_undo):
            return None
        keeping = PendingPoint(point)
        if not is_undo:
            self.keepings[point.counts[0]] = keeping
        self.waiting.append(
            (
                keeping,
                message_of(point, "traverse/bench-7/point", "msgpack", begun_ns, note),
            )
        )
        return keeping

    def take(self, *deliveries) -> None:
        for delivery in deliveries:
            self.measurement.dispatch(self.device, delivery)

    def latch(self, number, active, token, counts) -> LatchedCounts:
        now_ns = self.clock.now_ns
        return LatchedCounts(
            "base",
            number,
            active,
            token,
            now_ns // 1000,
            now_ns,
            now_ns,
            (0, 0, counts),  # joint 1 is on channel 2
            (0, 0, 0),
        )

    # -- expected results -------------------------------------------

    def compare_points(self) -> None:
        expected = expected_points(
            self.asked,
            self.attempts,
            self.keepings,
            self.sessions,
            self.failures,
        )
        captured = [
            (
                self.sessions.index(point.session),
                point.seq,
                point.retracts,
                point.trigger,
                point.counts[0],
                point.label,
                point.model,
            )
            for point in self.published
        ]
        assert captured == [line for line, _ in expected]
        assert len(self.acknowledged) == self.tokens
        done_at = dict(self.acknowledged)
        for place, (_, token) in enumerate(expected):
            # It was there before its edge was acknowledged.
            assert token is None or done_at[token] > place

    def compare_scans(self) -> None:
        by_scan: dict[str, list[int]] = {}
        for message in self.scans:
            counts = by_scan.setdefault(message.scan, [])
            assert message.seq == len(counts)
            assert (message.lost, message.dropped) == (0, 0)
            if len(message.counts):
                counts += message.counts[:, 0].tolist()
        assert set(by_scan) == set(self.scan_counts)
        for name, counts in by_scan.items():
            if name in self.held_scans:  # `test_scan_modes` says which exactly
                assert counts == sorted(set(counts) & set(self.scan_counts[name]))
            else:
                assert counts == self.scan_counts[name]
