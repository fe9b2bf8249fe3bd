"""A stuck thread stops the feeding; one that ended, or is idle, does not.

Notifications to systemd, on a real datagram socket of the test's own.
What `systemctl status` shows.
"""

import asyncio
import os
import re
import socket
import time

import pytest

from tests.daemon.values import SetClock
from traverse.daemon.acquisition.device import Device
from traverse.daemon.config.devices import DeviceSection
from traverse.daemon.monitoring.events import EventLog
from traverse.daemon.system.systemd import Notifier, StatusLine, Watchdog
from traverse.drivers.base.delivery_queue import DeliveryQueue
from traverse.drivers.base.heartbeat import Heartbeat
from traverse.drivers.base.values import DeviceCounters
from traverse.drivers.latch_board.driver import LatchBoardDriver
from traverse.testing.waiting import until

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
        self.watchdog.check()
        try:
            return self.heard.recv(100) == b"WATCHDOG=1"
        except BlockingIOError:
            return False

    def states(self) -> list[tuple[str, bool]]:
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
    assert bench.states() == [(source, True)]
    heartbeat.beat()
    assert bench.is_fed()
    assert bench.states() == [(source, True), (source, False)]


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
    assert bench.states() == [("taker-of-base", True)]
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


@pytest.fixture(params=["path", "abstract"])
def manager(request, tmp_path):
    """A socket like systemd's, and its name as in the environment."""
    name = str(tmp_path / "notify")
    if request.param == "abstract":
        name = f"@traverse-test-{os.getpid()}"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as heard:
        heard.bind(name.replace("@", "\0", 1))
        heard.settimeout(5)
        yield heard, name


def test_each_message_is_one_datagram(manager):
    heard, name = manager
    notifier = Notifier({"NOTIFY_SOCKET": name})
    notifier.ready()
    notifier.status("two\nlines")
    notifier.feed()
    notifier.stopping(2.5)
    notifier.starting(10)
    assert [heard.recv(4096) for _ in range(5)] == [
        b"READY=1",
        b"STATUS=two lines",
        b"WATCHDOG=1",
        b"STOPPING=1\nEXTEND_TIMEOUT_USEC=2500000",
        b"EXTEND_TIMEOUT_USEC=10000000",
    ]


def test_a_reload_tells_the_monotonic_time_at_which_it_began(manager):
    heard, name = manager
    before_us = time.clock_gettime_ns(time.CLOCK_MONOTONIC) // 1000
    Notifier({"NOTIFY_SOCKET": name}).reloading()
    after_us = time.clock_gettime_ns(time.CLOCK_MONOTONIC) // 1000
    first, second = heard.recv(4096).decode().split("\n")
    assert first == "RELOADING=1"
    key, _, value = second.partition("=")
    assert key == "MONOTONIC_USEC"
    assert before_us <= int(value) <= after_us


@pytest.mark.parametrize("name", ["", "/no/such/socket", "@no-such-socket"])
def test_without_a_manager_nothing_happens(name):
    Notifier({"NOTIFY_SOCKET": name} if name else {}).ready()


def test_a_manager_that_does_not_listen_does_not_hold_the_daemon_up(manager):
    _, name = manager
    notifier = Notifier({"NOTIFY_SOCKET": name})
    for _ in range(10_000):  # far more than the socket's queue holds
        notifier.feed()


@pytest.mark.parametrize(
    ("environment", "expected_s"),
    [
        ({"WATCHDOG_USEC": "3000000"}, 3.0),
        ({"WATCHDOG_USEC": "3000000", "WATCHDOG_PID": "ours"}, 3.0),
        ({"WATCHDOG_USEC": "3000000", "WATCHDOG_PID": "1"}, None),
        ({"WATCHDOG_USEC": "soon"}, None),
        ({}, None),
    ],
)
def test_the_watchdog_is_that_of_this_process(environment, expected_s):
    if environment.get("WATCHDOG_PID") == "ours":
        environment = {**environment, "WATCHDOG_PID": str(os.getpid())}
    assert Notifier({"NOTIFY_SOCKET": "@x", **environment}).watchdog_s == expected_s


def test_what_is_well_is_short():
    line = StatusLine()
    assert line.text("measuring", {"base": "ready"}, "connected", 0) == (
        "measuring: 1 device"
    )
    two = {"base": "ready", "wrist": "ready"}
    assert line.text("measuring", two, "connected", 1) == (
        "measuring: 2 devices, 1 point waits"
    )


def test_what_is_missing_is_reported_with_the_time_since_when():
    line = StatusLine()
    devices = {"base": "ready", "wrist": "lost"}
    first = line.text("measuring", devices, "lost", 12)
    time = r"\d\d:\d\d:\d\d"
    status = (
        rf"measuring: 1 device, wrist lost since {time}, broker lost since {time}, "
    )
    assert re.fullmatch(f"{status}12 points wait", first)


def test_the_time_is_that_of_the_change():
    now = ["12:00:00"]
    line = StatusLine(lambda: now[0])

    def status_after(state: str) -> str:
        return line.text("measuring", {"base": state}, "connected", 0)

    assert status_after("lost") == "measuring: 0 devices, base lost since 12:00:00"
    now[0] = "12:00:07"
    assert status_after("lost") == "measuring: 0 devices, base lost since 12:00:00"
    assert status_after("ready") == "measuring: 1 device"
    assert status_after("lost") == "measuring: 0 devices, base lost since 12:00:07"
