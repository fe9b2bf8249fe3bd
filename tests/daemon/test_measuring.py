import asyncio

import numpy as np
import pytest

from daemon.alignment import PartSystem
from daemon.arm_devices import ArmDevices
from daemon.capture import Capture, Triggers
from daemon.configuration import AssemblySection, UncertaintySection
from daemon.device import open_device
from daemon.device_section import section_of
from daemon.events import EventLog
from daemon.health import HealthReport
from daemon.live import LiveView
from daemon.measuring import Measuring
from daemon.pipeline import Pipeline
from daemon.poses import PoseBlock
from daemon.scan_plan import plan_scan
from daemon.scanner import Scanner
from daemon.uncertainty import Uncertainty
from drivers.values import (
    CountSamples,
    DeviceAlarm,
    DeviceCounters,
    DeviceFault,
    DeviceLost,
    DeviceTemperatures,
    DeviceUp,
    Identity,
    StreamStarted,
)
from protocol.encoding import decode, encode
from protocol.messages import BrokerHealth, Health, OutboxHealth, RecordingHealth
from protocol.messages.health import LATENCIES
from tests.daemon.values import (
    ARM,
    MODULI,
    SetClock,
    arm_model,
    count_samples,
    kept_at_once,
    latch,
)

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
        self.part = PartSystem()
        self.scanner = Scanner(
            self.clock,
            lambda scan: not self.scans.append(scan),
            0.05,
            part=self.part,
        )
        self.device = self.open("base")
        self.measuring = Measuring(
            clock=self.clock,
            devices=ArmDevices(model, [self.device]),
            settings=AssemblySection(),
            uncertainty=Uncertainty(UncertaintySection()),
            pipeline=Pipeline(model, self.clock),
            capture=Capture(self.clock, kept_at_once(self.offer), self.part),
            triggers=Triggers({("base", 0): "button", ("base", 1): "switch"}),
            scanner=self.scanner,
            live=LiveView(self.clock, 20.0, self.part),
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


@pytest.fixture
async def bench(tmp_path):
    bench = Bench(arm_model(tmp_path))
    yield bench
    bench.device.driver.close()


async def test_a_pressed_button_makes_a_point_and_two_events(bench):
    bench.take(DeviceUp("base", BOARD, False), latch((5, 6, 7)))
    bench.take(latch((5, 6, 7), active=False, token=1))
    (point,) = bench.points
    assert (point.trigger, point.seq) == ("button", 0)
    assert bench.codes() == ["button.pressed", "button.released"]
    assert [event.source for event in bench.events] == ["base/0", "base/0"]


async def test_the_probe_triggers_and_an_unwired_input_does_not(bench):
    bench.take(DeviceUp("base", BOARD, False))
    bench.take(latch((5, 6, 7), number=1), latch((5, 6, 7), number=2, token=1))
    assert [point.trigger for point in bench.points] == ["switch"]
    assert bench.codes() == ["switch.pressed"]


async def test_a_refused_capture_is_told(bench):
    bench.room = False
    bench.take(DeviceUp("base", BOARD, False), latch((5, 6, 7)))
    bench.room = True
    bench.take(latch((5, 6, 7), token=1))
    assert bench.codes().count("capture.refused") == 1
    assert [point.seq for point in bench.points] == [0]


async def test_a_latch_on_request_answers_whoever_waits(bench):
    waiting = asyncio.get_running_loop().create_future()
    bench.measuring.latches[7] = waiting
    bench.take(latch((5, 6, 7), number=None, token=7))
    point = await waiting
    assert (point.trigger, bench.points) == ("command", [point])
    assert bench.measuring.latches == {}


async def test_a_latch_that_comes_too_late_makes_no_point(bench):
    bench.take(latch((5, 6, 7), number=None, token=7))
    assert bench.points == []


async def test_a_board_that_does_not_fit_measures_nothing(bench):
    bench.take(DeviceUp("base", BOARD, False), count_samples(np.zeros((3, 3))))
    assert len(bench.live) == 1
    bench.take(
        DeviceLost("base", "unplugged", "plug it in"),
        DeviceUp("base", OTHER_BOARD, True),
        count_samples(np.zeros((3, 1)), first=100),
        latch((5,)),
    )
    assert bench.device.state == "failed"
    assert len(bench.live) == 1
    assert bench.points == []
    assert "device.mismatch" in bench.codes()
    assert "capture.refused" in bench.codes()
    bench.take(DeviceUp("base", BOARD, True), latch((5, 6, 7), token=1))
    assert bench.device.state == "ready"
    assert len(bench.points) == 1


async def test_counts_of_another_device_are_not_the_arms(bench):
    other = bench.open("handle")
    bench.take(
        DeviceUp("handle", OTHER_BOARD, False),
        count_samples(np.zeros((3, 1))),
        latch((5,), number=None),
        device=other,
    )
    other.driver.close()
    assert (other.state, other.problems) == ("ready", [])
    assert (bench.live, bench.points) == ([], [])


async def test_a_lost_device_is_told_once_and_cleared_once(bench):
    lost = DeviceLost("base", "unplugged", "plug it in")
    bench.take(lost)
    assert bench.codes() == []  # at start-up it is told otherwise
    assert bench.device.heard.is_set()
    bench.take(DeviceUp("base", BOARD, False), lost, lost)
    assert bench.device.state == "lost"
    bench.take(DeviceUp("base", BOARD, False))
    states = [(event.code, event.active) for event in bench.events]
    assert states == [("device.lost", True), ("device.lost", False)]
    assert bench.device.reconnects == 1
    assert bench.changes == 5


async def test_a_restarted_board_is_told_and_the_turns_are_taken_afresh(bench):
    bench.take(DeviceUp("base", BOARD, False))
    turning = np.linspace(0, 3 * (1 << 20), 60)[:, np.newaxis] * [1, 0, 0]
    bench.take(count_samples(turning))
    bench.take(DeviceUp("base", BOARD, True), latch((0, 0, 0)))
    assert "device.restarted" in bench.codes()
    assert bench.points[0].counts[1] == 0  # not three turns on


async def test_a_scan_follows_its_stream_only(bench, tmp_path):
    plan = plan_scan(100.0, 100.0)
    bench.scanner.start(plan, arm_model(tmp_path), "session")
    bench.take(DeviceUp("base", BOARD, False), StreamStarted("base", 3, 50.0))
    assert not bench.measuring.stream_started.is_set()
    bench.take(StreamStarted("base", 4, 100.0))
    assert bench.measuring.stream_started.is_set()
    bench.take(
        count_samples(np.zeros((9, 3)), stream=3),
        count_samples(np.zeros((5, 3)), stream=4),
    )
    assert bench.scanner.stop() == 5


async def test_live_poses_are_thinned_to_their_rate(bench):
    bench.take(DeviceUp("base", BOARD, False))
    for first in range(0, 100, 2):  # a second in blocks of 20 ms
        bench.take(count_samples(np.zeros((2, 3)), first=first))
    assert 19 <= len(bench.live) <= 21
    assert bench.live[0].speed_mm_s is None
    assert bench.live[1].speed_mm_s == 0.0


async def test_alarms_are_raised_and_cleared_with_their_channel(bench):
    weak = ("encoder signal weak", 350)
    bench.take(
        DeviceAlarm("base", 1, True, 1, *weak),
        DeviceAlarm("base", 1, True, 1, *weak),
        DeviceAlarm("base", None, True, 6, "frames dropped", 9),
        DeviceAlarm("base", 1, False, 1, *weak),
        DeviceAlarm("base", 2, True, "node_lost", "node 5 is silent", 0, "look at it"),
    )
    told = [(event.code, event.source, event.active) for event in bench.events]
    assert told == [
        ("alarm.1", "base/1", True),
        ("alarm.6", "base", True),
        ("alarm.1", "base/1", False),
        ("alarm.node_lost", "base/2", True),
    ]
    assert "350" in bench.events[0].text
    named = bench.events[-1]
    assert (named.text, named.remedy) == ("node 5 is silent", "look at it")


WARM = """
[[effects]]
kind = "thermal_expansion"
expansion_per_c = 1e-5
"""


async def test_effects_without_a_temperature_are_told_once_it_should_have_come(
    tmp_path,
):
    bench = Bench(arm_model(tmp_path, ARM + WARM))
    bench.take(DeviceUp("base", BOARD, False), count_samples(np.zeros((3, 3))))
    bench.take(latch((5, 6, 7)))
    assert bench.points[0].quality.flags == ("temperature_unknown",)
    assert "device.temperature_unknown" not in bench.codes()
    bench.clock.now_ns += 5 * 10**9
    for first in (500, 503):
        bench.take(count_samples(np.zeros((3, 3)), first=first))
    bench.take(DeviceTemperatures("base", (None, 21.5)), latch((5, 6, 7), token=1))
    assert bench.points[1].quality.ok
    bench.take(DeviceTemperatures("base", (None, None)))
    told = [e for e in bench.events if e.code == "device.temperature_unknown"]
    assert [event.active for event in told] == [True, False, True]
    assert "20 C is taken" in told[0].text
    assert "sensor" in told[0].remedy
    bench.device.driver.close()


async def test_a_device_that_comes_back_tells_its_temperature_anew(bench):
    bench.take(
        DeviceUp("base", BOARD, False),
        DeviceTemperatures("base", (21.5,)),
        DeviceLost("base", "unplugged", "plug it in"),
        DeviceUp("base", BOARD, False),
        latch((5, 6, 7)),
    )
    assert bench.points[0].temperature_c is None


async def test_without_effects_nobody_misses_the_temperature(bench):
    bench.take(DeviceUp("base", BOARD, False))
    bench.clock.now_ns += 60 * 10**9
    bench.take(count_samples(np.zeros((3, 3))), DeviceTemperatures("base", ()))
    assert bench.codes() == []


async def test_health_tells_figures_and_takes_them_anew_each_time(bench):
    bench.take(
        DeviceUp("base", BOARD, False),
        DeviceCounters("base", {"samples_received": 200, "samples_lost": 3}),
        DeviceTemperatures("base", (None, 21.5)),
        DeviceFault("base", "samples_lost", "3 lost", "faster line", 3),
    )
    samples = count_samples(np.zeros((4, 3)))
    bench.clock.now_ns = samples.received_ns + 250_000
    bench.take(samples, latch((1, 2, 3), now_ns=bench.clock.now_ns - 40_000))
    bench.clock.now_ns = 10**12 + 2 * 10**9
    first = health(bench)
    assert first.counters["samples_received"] == 200
    assert first.counters["samples_lost"] == 3
    assert first.counters["points_captured"] == 1
    assert first.rates_hz["samples_received"] == pytest.approx(100.0)
    assert first.uptime_s == pytest.approx(2.0)
    assert first.temperatures_c == {"arm": 21.5}
    assert first.latencies["queue_wait"].max_us == 250.0
    assert first.latencies["capture_to_publish"].p50_us == 40.0
    assert set(first.latencies) <= set(LATENCIES)
    (device,) = first.devices
    assert device.rate_hz == pytest.approx(2.0)
    assert device.temperatures_c == {"1": 21.5}
    assert device.age_s == pytest.approx(2 - 0.03125)  # since the last of them
    assert first.rss_bytes > 1_000_000
    bench.clock.now_ns += 10**9
    second = health(bench)
    assert second.latencies == {}
    assert second.rates_hz["samples_received"] == 0.0
    assert second.counters["samples_received"] == 200
    assert decode(Health, encode(second, "msgpack")) == second


def health(bench) -> Health:
    return bench.health.message(
        arm="bench-7",
        session="s",
        devices=[bench.device],
        broker=BrokerHealth(
            state="connected",
            host="localhost",
            port=1883,
            reconnects=0,
            queued=0,
            queue_limit=10,
            unacknowledged=0,
            dropped=0,
        ),
        outbox=OutboxHealth(
            state="ready", points=0, unsent=0, bytes=0, oldest_unsent_ns=None
        ),
        spool=None,
        recording=RecordingHealth(
            state="off",
            name=None,
            bytes=0,
            flight_bytes=0,
            queued=0,
            dropped=0,
            kept=0,
            kept_dropped=0,
        ),
        counters={"points_captured": len(bench.points)},
        temperature_c=bench.device.temperature_c,
        lacks={},
        skew_mm=None,
    )


def test_blocks_of_one_arm_join_in_order(tmp_path):
    pipeline = Pipeline(arm_model(tmp_path), SetClock())
    samples = count_samples(np.arange(30).reshape(10, 3))
    assert isinstance(samples, CountSamples)
    block = pipeline.poses(samples)
    parts = [block.rows(slice(0, 4)), block.rows(slice(4, 10))]
    assert PoseBlock.joined(parts).xyz_mm.tobytes() == block.xyz_mm.tobytes()
