"""The condition that every reading is a new one: two repeats, or one that is clear."""

import numpy as np
import pytest

from tests.daemon.board_harness import BOARD, Bench
from tests.daemon.values import SetClock, arm_model, count_samples
from tests.protocol.message_examples import POINT
from traverse.daemon.conditions.monitor import ConditionMonitor
from traverse.daemon.monitoring.events import EventLog
from traverse.daemon.pose.published import PublishedNumbers
from traverse.daemon.readings.repeat_monitor import RepeatMonitor
from traverse.daemon.references.jumps import JumpMonitor
from traverse.drivers.base.values import DeviceUp

CONDITION = "single_readings"
MODULI = (1 << 20, 1 << 23, 1 << 16)  # of the channels: J2, J3, J1
START_NS = 10**12
WEAK, CLEAR = 20, 100  # steps of J1 [counts]: 1.9 and 9.6 mrad in 10 ms


class Arm:
    """Three joints that are led steadily, at 100 Hz."""

    def __init__(self, folder):
        self.model, self.clock, self.events = arm_model(folder), SetClock(), []
        log = EventLog(self.clock, self.events.append)
        self.conditions = ConditionMonitor(self.clock, log)
        self.conditions.use({CONDITION: ("base",)}, ("base",))
        self.conditions.establish(CONDITION, "base")
        self.monitor = self.new_monitor()
        self.n, self.points, self.counts = 0, [], np.zeros(3, int)

    def new_monitor(self):
        published = PublishedNumbers(lambda ns: ns, self.points_since)
        return RepeatMonitor(self.conditions, published)

    def new_monitor_of(self, state):
        monitor = self.new_monitor()
        monitor.resume(state)
        return monitor

    def points_since(self, since_ns):
        return [point for point in self.points if point.time_ns >= since_ns]

    def lead(self, step, repeated=(), n=100, channels=(2,)):
        """Read n samples; those in ``repeated`` have the counts before."""
        steps = np.zeros((n, 3), int)
        steps[:, list(channels)] = np.minimum(np.arange(n), step)[:, None]
        path = self.counts + np.cumsum(steps, axis=0)
        self.counts = path[-1].copy()
        for row in repeated:
            path[row, list(channels)] = path[row - 1, list(channels)]
        for begin in range(0, n, 5):
            block = count_samples(
                path[begin : begin + 5] % MODULI, first=self.n + begin
            )
            self.clock.now_ns = int(block.sample_time_ns[-1])
            self.monitor.add(self.model, block, MODULI)
        self.n += n

    @property
    def is_in_doubt(self):
        return not self.conditions.is_established(CONDITION, "base")


@pytest.fixture
def arm(tmp_path):
    return Arm(tmp_path)


def test_one_repeat_may_be_chance_and_two_are_none(arm):
    arm.lead(WEAK, [60])
    assert not arm.is_in_doubt
    arm.lead(WEAK)
    arm.lead(WEAK, [60])
    assert arm.is_in_doubt
    event = arm.events[-1]
    assert event.text.startswith(
        "2 readings of J1 (base/2) within 2.02 s repeated the count before, up to 1.9 "
        "mrad off"
    )
    assert "print `x` or no line" in event.remedy
    assert event.data["readings"] == 2
    assert event.data["flags"] == "stale"
    assert int(event.data["from_ns"]) == START_NS + 590_000_000
    assert int(event.data["until_ns"]) == START_NS + 2_610_000_000


def test_two_that_are_far_apart_may_be_chance(arm):
    arm.lead(WEAK, [60])
    for _ in range(31):
        arm.lead(0)
    arm.lead(WEAK, [60])
    assert not arm.is_in_doubt


def test_all_joints_at_once_are_one_failure(arm):
    arm.lead(WEAK, [60], channels=(0, 1, 2))
    assert not arm.is_in_doubt


def test_one_that_no_hand_could_make_suffices(arm):
    arm.lead(CLEAR, [120], n=150)
    assert arm.is_in_doubt


def test_the_event_names_the_points_of_the_time_in_which_it_did_not_show(arm):
    arm.points = [
        POINT.model_copy(
            update={
                "seq": seq,
                "id": f"p-{seq}",
                "time_ns": START_NS + round(1e9 * at_s),
            }
        )
        for seq, at_s in enumerate((0.5, 0.61, 1.5))
    ]
    arm.lead(WEAK, [60])
    arm.lead(WEAK, [70])
    event = arm.events[-1]
    assert event.data["points"] == "p-1 p-2"
    assert "by seq: 1, 2" in event.text


def test_another_joint_is_named_too_and_more_of_the_same_are_not(arm):
    arm.lead(WEAK, [60, 80])
    n_events = len(arm.events)
    arm.lead(WEAK, [60, 80])
    assert len(arm.events) == n_events
    arm.lead(WEAK, [60], channels=(0,))
    assert "J2 (base/0), J1 (base/2)" in arm.events[-1].text


def test_it_ends_after_motion_without_and_not_at_rest(arm):
    arm.lead(WEAK, [60, 80])
    for _ in range(30):
        arm.lead(0)
    assert arm.is_in_doubt
    for _ in range(15):
        arm.lead(WEAK)
    arm.lead(WEAK, [60])
    for _ in range(15):
        arm.lead(WEAK)
    assert arm.is_in_doubt  # 20 s since the latest
    for _ in range(15):
        arm.lead(WEAK)
    assert not arm.is_in_doubt
    assert arm.events[-1].text == "base has repeated no count in 20 s of motion"


def test_its_state_continues_in_a_replay(arm):
    arm.lead(WEAK, [60])
    arm.monitor = arm.new_monitor_of(arm.monitor.state)
    arm.lead(WEAK, [60])
    assert arm.is_in_doubt
    other = arm.new_monitor_of(arm.monitor.state)
    assert other.is_in_doubt("base")
    assert other.state == arm.monitor.state


def test_other_encoders_begin_without_doubt(arm):
    arm.lead(WEAK, [60, 80])
    arm.monitor.begin("base")  # it answers again
    assert arm.monitor.is_in_doubt("base")
    arm.monitor.begin_all()
    assert not arm.monitor.is_in_doubt("base")


async def test_the_new_count_after_old_ones_is_no_jump(tmp_path):
    """After five readings J1 is at 11.5 mrad at once, of which 9.6 are no hand's."""
    path = np.zeros((200, 3), int)
    path[:, 2] = np.cumsum(np.minimum(np.arange(200), WEAK))
    for row in (80, 150):
        path[row : row + 5] = path[row - 1]
    samples = count_samples(path)
    turns, places = np.array(MODULI), np.arange(3)
    jump_monitor = JumpMonitor(places, turns, 2.0 * np.pi / turns, 0, 20.0)
    assert len(jump_monitor.add(samples)) == 2

    bench = Bench(arm_model(tmp_path))
    bench.take(DeviceUp("base", BOARD, restarted=False))
    bench.measurement.references.confirm()
    bench.take(samples)
    conditions = bench.measurement.conditions
    assert conditions.is_established("reference", "base")
    assert not conditions.is_established(CONDITION, "base")
    bench.device.driver.close()
