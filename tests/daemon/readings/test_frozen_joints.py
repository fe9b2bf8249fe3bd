"""Counts that no longer follow their joints, and joints that only rest."""

from dataclasses import dataclass

import numpy as np
import pytest

from tests.daemon.values import SetClock, arm_model
from tests.protocol.message_examples import POINT
from traverse.daemon.conditions.monitor import ConditionMonitor
from traverse.daemon.conditions.table import ARM
from traverse.daemon.monitoring.events import EventLog
from traverse.daemon.pose.poses import ArmReadings
from traverse.daemon.pose.published import PublishedNumbers
from traverse.daemon.readings.frozen_joints import FrozenJointMonitor
from traverse.drivers.base.values import CountSamples

RATES_HZ = (50.0, 100.0, 1000.0)
SPEEDS_RAD_S = np.array([0.4, -0.6, 0.8])


@dataclass
class Arm:
    """An arm of three joints whose angles a test gives at every sample."""

    model: object
    rate_hz: float

    def __post_init__(self):
        self.clock, self.events = SetClock(), []
        log = EventLog(self.clock, self.events.append)
        self.conditions = ConditionMonitor(self.clock, log)
        self.conditions.use({"channels": (ARM,)}, ())
        self.conditions.establish("channels")
        self.monitor = self.new_monitor()
        self.n, self.points = 0, []

    def new_monitor(self):
        published = PublishedNumbers(lambda ns: ns, self.points_since)
        return FrozenJointMonitor(self.conditions, published)

    def points_since(self, since_ns):
        return [point for point in self.points if point.time_ns >= since_ns]

    def read(self, angles_rad, rows=7):
        """Reads (n, 3) angles in blocks; returns after how many it was in doubt."""
        counts = np.rint(angles_rad / self.model.per_count_rad).astype(np.int64)
        after = None
        for begin in range(0, len(counts), rows):
            block = counts[begin : begin + rows]
            seq = self.n + np.arange(len(block))
            times_ns = 10**12 + np.rint(seq * 1e9 / self.rate_hz).astype(np.int64)
            samples = CountSamples(
                "base",
                1,
                seq,
                times_ns,
                int(times_ns[-1]),
                times_ns,
                np.zeros(len(block), np.uint8),
                block.astype(np.uint32),
                np.zeros(block.shape, np.uint8),
            )
            self.n += len(block)
            self.clock.now_ns = int(times_ns[-1])
            quality = np.zeros(len(block), np.uint32)
            self.monitor.add(
                self.model, ArmReadings(samples, block, block * 1.0, quality, None)
            )
            if after is None and not self.conditions.is_established("channels"):
                after = begin + len(block)
        return after

    def steady(self, seconds):
        times_s = np.arange(round(seconds * self.rate_hz)) / self.rate_hz
        return np.outer(times_s, SPEEDS_RAD_S)


@pytest.fixture(params=RATES_HZ)
def arm(request, tmp_path):
    return Arm(arm_model(tmp_path), request.param)


@pytest.mark.parametrize("joint", range(3))
def test_a_count_that_stops_dead_beside_moving_joints_is_frozen(arm, joint):
    angles_rad = arm.steady(2.0)
    stop = round(arm.rate_hz)
    angles_rad[stop:, joint] = angles_rad[stop, joint]
    after = arm.read(angles_rad)
    assert after is not None
    assert 0.0 < (after - stop) / arm.rate_hz <= 0.35
    assert f"J{joint + 1}" in arm.events[-1].text

    arm.read(angles_rad[-1:] + arm.steady(0.3))
    assert arm.conditions.is_established("channels")
    assert not arm.events[-1].active


@pytest.mark.parametrize("joint", range(3))
@pytest.mark.parametrize("braking_rad_s2", [1.0, 3.0, 5.0])
def test_a_joint_that_brakes_beside_others_only_rests(arm, joint, braking_rad_s2):
    angles_rad = arm.steady(3.0)
    times_s = np.arange(len(angles_rad)) / arm.rate_hz
    speed_rad_s = SPEEDS_RAD_S[joint]
    lasts_s = abs(speed_rad_s) / braking_rad_s2
    braked_s = np.clip(times_s - 1.0, 0.0, lasts_s)
    slower_rad = speed_rad_s * braked_s * (1 - braked_s / lasts_s / 2)
    angles_rad[:, joint] = speed_rad_s * np.minimum(times_s, 1.0) + slower_rad
    assert arm.read(angles_rad) is None


def test_a_block_that_begins_with_a_frozen_count_is_in_doubt_whole(arm):
    angles_rad = arm.steady(2.0)
    frozen = len(angles_rad) // 2
    angles_rad[frozen:, 0] = angles_rad[frozen, 0]
    arm.read(angles_rad, rows=1)
    assert not arm.conditions.is_established("channels")
    varies = angles_rad[-7:].copy()
    varies[3:, 0] += 0.1
    arm.read(varies)
    assert not arm.conditions.is_established("channels")
    arm.read(varies[3:])
    assert arm.conditions.is_established("channels")


def test_a_count_that_froze_shows_although_the_arm_rests_soon_after(arm):
    angles_rad = arm.steady(2.0)
    stop = round(arm.rate_hz)
    angles_rad[stop:, 0] = angles_rad[stop, 0]
    rest = stop + round(0.1 * arm.rate_hz)
    angles_rad[rest:] = angles_rad[rest]
    assert arm.read(angles_rad) is not None


def test_the_event_names_the_points_that_were_taken_before_it_showed(arm):
    angles_rad = arm.steady(2.0)
    stop = round(arm.rate_hz)
    angles_rad[stop:, 0] = angles_rad[stop, 0]
    arm.points = [
        POINT.model_copy(
            update={
                "seq": seq,
                "id": f"p-{seq}",
                "time_ns": 10**12 + round(1e9 * at_s),
            }
        )
        for seq, at_s in enumerate((0.9, 1.05, 1.1))
    ]
    arm.read(angles_rad)
    event = arm.events[-1]
    assert event.data["points"] == " ".join(p.id for p in arm.points[1:])
    assert "by seq: 1, 2" in event.text
    assert 0.05 <= event.data["constant_s"] <= 0.35
    # Samples of a scan from then on are named by their time.
    from_ns, until_ns = (int(event.data[name]) for name in ("from_ns", "until_ns"))
    constant_ns = until_ns - from_ns
    assert constant_ns == pytest.approx(1e9 * event.data["constant_s"], abs=1e6)
    # It froze at some instant after the last reading before.
    assert 0 < 10**12 + 10**9 - from_ns <= 2e9 / arm.rate_hz


def test_an_arm_that_stops_dead_only_rests(arm):
    angles_rad = arm.steady(2.0)
    angles_rad[round(arm.rate_hz) :] = angles_rad[round(arm.rate_hz)]
    assert arm.read(angles_rad) is None


def test_an_arm_that_brakes_as_a_whole_only_rests(arm):
    times_s = np.arange(round(4 * arm.rate_hz)) / arm.rate_hz
    braked_s = np.clip(times_s - 1.0, 0.0, 0.25)
    moved_s = np.minimum(times_s, 1.0) + braked_s * (1.0 - braked_s / 0.5)
    assert arm.read(np.outer(moved_s, SPEEDS_RAD_S)) is None


def test_a_joint_that_never_moved_beside_others_only_rests(arm):
    angles_rad = arm.steady(3.0)
    angles_rad[:, 1] = 0.0
    assert arm.read(angles_rad) is None


def test_a_spoilt_count_of_a_resting_joint_is_no_stop(arm):
    angles_rad = arm.steady(3.0)
    angles_rad[:, 1] = 0.0
    angles_rad[round(arm.rate_hz), 1] = 0.2
    assert arm.read(angles_rad) is None


def noisy(arm, seconds, rng):
    n = round(seconds * arm.rate_hz)
    return rng.normal(0.0, 2.0, (n, 3)) * np.abs(arm.model.per_count_rad)


def test_noise_that_ends_shows_a_count_that_froze_at_rest(arm):
    rng = np.random.default_rng(5)
    assert arm.read(noisy(arm, 25.0, rng)) is None
    angles_rad = noisy(arm, 4.0, rng)
    angles_rad[:, 0] = 0.0
    assert arm.read(angles_rad) is None  # others rest, too

    angles_rad = noisy(arm, 4.0, rng) + arm.steady(4.0)
    angles_rad[:, 0] = 0.0
    assert arm.read(angles_rad) is not None
    assert "its noise has ended" in arm.events[-1].text


def test_noise_that_ends_in_all_counts_at_once_needs_no_motion(arm):
    rng = np.random.default_rng(7)
    assert arm.read(noisy(arm, 25.0, rng)) is None
    assert arm.read(np.zeros((round(3 * arm.rate_hz), 3))) is not None
    assert "its noise has ended" in arm.events[-1].text


def test_a_count_that_has_been_still_before_may_be_still_again(arm):
    rng = np.random.default_rng(6)
    for _ in range(2):
        angles_rad = noisy(arm, 30.0, rng)
        angles_rad[round(22 * arm.rate_hz) : round(26 * arm.rate_hz), 0] = 0.0
        assert arm.read(angles_rad) is None
    angles_rad = noisy(arm, 4.0, rng) + arm.steady(4.0)
    angles_rad[:, 0] = 0.0
    assert arm.read(angles_rad) is None


def test_its_state_continues_in_a_replay(arm):
    angles_rad = arm.steady(2.0)
    angles_rad[round(arm.rate_hz) :, 2] = angles_rad[round(arm.rate_hz), 2]
    arm.read(angles_rad)
    other = arm.new_monitor()
    other.resume(arm.monitor.state)
    assert list(other.counts) == [2]
    assert other.state == arm.monitor.state
