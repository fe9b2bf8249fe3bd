"""Buttons with gestures: what is captured, when, of which counts, what acknowledged."""

import asyncio

import pytest

from tests.daemon.arm_harness import ArmBench, edge
from tests.daemon.two_devices import BEGIN_NS, base, wrist
from tests.daemon.values import SetClock
from traverse.daemon.commands.scans import ButtonScans
from traverse.daemon.config.schema import InputSection
from traverse.daemon.errors import RequestRefusedError
from traverse.daemon.monitoring.events import EventLog
from traverse.daemon.points.buttons import EDGE_DELAY_NS
from traverse.protocol.messages import PointArgs
from traverse.testing.waiting import until

ALL = {"click": "point", "double": "undo", "hold": "scan"}


class Hand:
    """Presses a button of the bench at times in ms, while both devices stream."""

    def __init__(self, folder, **meanings):
        self.bench = ArmBench(
            folder,
            capture={
                "inputs": (
                    InputSection(source="handle/0", trigger="button", **meanings),
                )
            },
        )
        self.bench.up()
        self.at = self.token = 0
        self.done = self.bench.actions
        self.until(400)

    def until(self, ms):
        """Advance time: samples arrive and the daemon polls."""
        while self.at < ms:
            begin, self.at = self.at, min(self.at + 50, ms)
            numbers = range(begin // 10, self.at // 10)
            self.bench.take(
                wrist(rate_hz=100.0, speed=0.0).samples(numbers),
                base(speed=0.0).samples(numbers),
            )
            self.bench.clock.now_ns = BEGIN_NS + self.at * 1_000_000
            self.bench.measurement.process_timeouts()

    def press(self, ms, *, active=True):
        instant_ns = BEGIN_NS + ms * 1_000_000
        self.bench.take(edge("handle", instant_ns, self.token, active=active))
        self.token += 1

    def click(self, ms, down_ms=80):
        self.until(ms + 10)
        self.press(ms)
        self.until(ms + down_ms + 10)
        self.press(ms + down_ms, active=False)

    @property
    def acknowledged(self):
        return self.bench.acknowledged("handle")

    def times_ms(self):
        offset_ns = self.bench.clock.offset_ns + BEGIN_NS
        return [(p.time_ns - offset_ns) / 1e6 for p in self.bench.points]


@pytest.fixture
def make_hand(tmp_path):
    hands = []

    def make(**meanings):
        hands.append(Hand(tmp_path, **meanings))
        return hands[-1]

    yield make
    for hand in hands:
        hand.bench.close()


async def test_a_button_that_knows_clicks_alone_takes_its_point_at_the_press(make_hand):
    hand = make_hand()
    hand.until(510)
    hand.press(495)
    assert (hand.times_ms(), hand.acknowledged) == ([495.0], [0])


async def test_a_click_is_decided_later_and_taken_from_the_press(make_hand):
    hand = make_hand(**ALL)
    hand.click(500)
    hand.until(850)
    assert (hand.bench.points, hand.acknowledged) == ([], [])
    hand.until(1000)
    assert (hand.times_ms(), hand.acknowledged) == ([500.0], [0, 1])
    assert hand.done == []


async def test_a_double_does_its_action_once(make_hand):
    hand = make_hand(**ALL)
    hand.click(500)
    hand.until(1500)
    hand.click(1500)
    hand.click(1700)
    hand.until(2500)
    first, retraction = hand.bench.points
    assert retraction.retracts == first.id
    assert retraction.trigger == "button"
    assert hand.acknowledged == [0, 1, 2, 3, 4, 5]
    codes = hand.bench.codes()
    assert (codes.count("button.double"), codes.count("capture.undone")) == (1, 1)
    assert codes.count("button.pressed") == 3


async def test_a_hold_scans_from_when_it_is_certain_to_its_release(make_hand):
    hand = make_hand(**ALL)
    hand.until(510)
    hand.press(500)
    hand.until(899 + EDGE_DELAY_NS // 1_000_000)
    assert hand.done == []
    hand.until(1000)
    assert (hand.done, hand.acknowledged) == (["scan"], [0])
    hand.until(2000)
    hand.press(1990, active=False)
    assert (hand.done, hand.acknowledged) == (["scan", "stop"], [0, 1])
    assert hand.bench.points == []


async def test_a_release_that_was_under_way_still_makes_a_click(make_hand):
    hand = make_hand(**ALL)
    hand.until(510)
    hand.press(500)
    hand.until(940)
    hand.press(899, active=False)  # 40 ms on its way
    hand.until(1500)
    assert (hand.times_ms(), hand.done) == ([500.0], [])


async def test_points_keep_their_order_behind_an_undecided_press(make_hand):
    hand = make_hand(**ALL)
    hand.until(510)
    hand.press(500)
    bench = hand.bench
    bench.take(edge("base", BEGIN_NS + 502_000_000, 0, counts=(1, 2, 3)))
    asking = asyncio.create_task(bench.point_requests.take_point(PointArgs()))
    await asyncio.sleep(0)
    hand.until(580)
    assert bench.points == []
    hand.press(570, active=False)
    hand.until(1000)
    await asking
    assert [p.trigger for p in bench.points] == ["button", "switch", "command"]
    assert hand.times_ms()[:2] == [500.0, 502.0]


async def test_a_press_averages_from_its_instant_on(make_hand):
    hand = make_hand(click="average", long="session")
    hand.until(510)
    hand.press(500)
    hand.until(610)
    hand.press(600, active=False)
    hand.until(900)
    assert hand.bench.points == []
    hand.until(1200)
    (point,) = hand.bench.points
    assert point.samples == 51  # 0.5 s of 100 Hz, both ends included
    assert hand.times_ms() == [750.0]
    assert hand.acknowledged == [0, 1]
    session = hand.bench.capture.session.id
    hand.press(1190)
    hand.until(3000)
    assert hand.bench.capture.session.id != session
    assert hand.done == ["session"]


async def test_none_takes_no_point_and_is_reported(make_hand):
    hand = make_hand(click="none", double="point")
    hand.click(500)
    hand.until(1500)
    assert (hand.bench.points, hand.acknowledged) == ([], [0, 1])
    hand.click(1500)
    hand.click(1700)
    assert hand.times_ms() == [1500.0]  # the first press of the double


async def test_an_undo_without_points_is_refused_and_acknowledged(make_hand):
    hand = make_hand(click="undo")
    hand.until(510)
    hand.press(500)
    assert hand.acknowledged == [0]
    assert "capture.refused" in hand.bench.codes()


async def test_scans_of_buttons_come_one_after_the_other_and_tell_refusals():
    refusals, done, gate = [], [], asyncio.Event()

    async def change_scan(args):
        await gate.wait()
        done.append(args.action)
        if args.action == "start":
            raise RequestRefusedError("scan.rate", "too fast", "go slower")
        return {}

    events = EventLog(SetClock(), refusals.append)
    actions = ButtonScans(events)
    running = asyncio.create_task(actions.run(change_scan))
    for _ in range(2):
        actions.request("start")
        actions.request("stop")
    gate.set()
    await until(lambda: len(done) == 4, "all four actions")
    running.cancel()
    await asyncio.gather(running, return_exceptions=True)
    assert done == ["start", "stop"] * 2
    assert {event.code for event in refusals} == {"scan.refused"}
