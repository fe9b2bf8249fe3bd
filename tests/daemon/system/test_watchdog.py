"""A stuck thread stops the feeding; one that ended, or is idle, does not."""

import asyncio
import socket

import pytest

from tests.daemon.values import SetClock
from tests.drivers.taken import until
from traverse.daemon.acquisition.device import Device
from traverse.daemon.config.devices import DeviceSection
from traverse.daemon.monitoring.events import EventLog
from traverse.daemon.system.systemd import Notifier, Watchdog
from traverse.drivers.base.delivery_queue import DeliveryQueue
from traverse.drivers.base.heartbeat import Heartbeat
from traverse.drivers.base.values import DeviceCounters
from traverse.drivers.latch_board.driver import LatchBoardDriver

WATCHDOG_S = 10.0
S = 1_000_000_000


class Bench:
    """One device whose reader is not started, on a clock that is set."""

    def __init__(self, tmp_path) -> None:
        self.clock = SetClock()
        self.events = []
        self.heard = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.heard.bind(str(tmp_path / "notify"))
        self.heard.setblocking(False)
        self.delivery_queue = DeliveryQueue(asyncio.get_running_loop())
        table = {"id": "base", "driver": "latch-board", "port": "/nowhere"}
        section = DeviceSection.from_table(table)
        self.driver = LatchBoardDriver(
            "base",
            section.options,
            self.delivery_queue,
            monotonic_ns=self.clock.monotonic_ns,
        )
        self.outbox = Heartbeat("thread of the outbox", self.clock.monotonic_ns)
        notifier = Notifier(
            {
                "NOTIFY_SOCKET": str(tmp_path / "notify"),
                "WATCHDOG_USEC": str(int(WATCHDOG_S * 1e6)),
            }
        )
        self.watchdog = Watchdog(
            notifier,
            [Device(section, self.delivery_queue, self.driver)],
            lambda: [self.outbox],
            EventLog(self.clock, self.events.append),
        )

    def is_fed(self) -> bool:
        """Check once; return whether systemd is notified."""
        self.watchdog.check()
        try:
            return self.heard.recv(100) == b"WATCHDOG=1"
        except BlockingIOError:
            return False

    def told(self) -> list[tuple[str, bool]]:
        return [(e.source, e.active) for e in self.events]


@pytest.fixture
async def bench(tmp_path):
    bench = Bench(tmp_path)
    with bench.heard:
        yield bench
        bench.driver.close()


async def test_who_rests_by_design_does_not_stop_the_feeding(bench):
    for _ in range(5):
        bench.clock.now_ns += 100 * S
        assert bench.is_fed()


@pytest.mark.parametrize("who", ["reader", "outbox"])
async def test_a_thread_that_is_stuck_stops_the_feeding_until_it_continues(bench, who):
    heartbeat = bench.driver.heartbeat if who == "reader" else bench.outbox
    heartbeat.beat()
    bench.clock.now_ns += 5 * S
    assert bench.is_fed()  # half of the watchdog's time is not exceeded
    bench.clock.now_ns += 1
    assert not bench.is_fed()
    assert not bench.is_fed()
    source = heartbeat.name.replace(" ", "-")
    assert bench.told() == [(source, True)]
    heartbeat.beat()
    assert bench.is_fed()
    assert bench.told() == [(source, True), (source, False)]


async def test_a_turn_that_was_said_to_be_long_may_be_long(bench):
    bench.driver.heartbeat.beat(60.0)
    bench.clock.now_ns += 60 * S
    assert bench.is_fed()
    bench.clock.now_ns += 1
    assert not bench.is_fed()


async def test_what_nobody_takes_stops_the_feeding_at_the_second_look(bench):
    bench.delivery_queue.put(DeviceCounters("base", {}))
    await asyncio.sleep(0)
    assert bench.is_fed()  # it may have arrived this moment
    assert not bench.is_fed()
    assert bench.told() == [("taker-of-base", True)]
    await bench.delivery_queue.take()
    assert bench.is_fed()


async def test_what_waits_at_every_look_but_is_taken_between_is_no_fault(bench):
    for _ in range(3):
        bench.delivery_queue.put(DeviceCounters("base", {}))
        await asyncio.sleep(0)
        assert bench.is_fed()
        await bench.delivery_queue.take()


async def test_the_reader_of_a_device_that_is_not_there_continues(bench):
    bench.driver.start()  # its port does not exist: it tries again and again
    await until(
        lambda: bench.delivery_queue.is_due, "it tells that the port is missing"
    )
    beaten = bench.driver.heartbeat._last_beat
    bench.clock.now_ns += 100 * S
    await until(lambda: bench.driver.heartbeat._last_beat != beaten, "another try")
    assert bench.driver.heartbeat.overdue_s(1.0) is None
