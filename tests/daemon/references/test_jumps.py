"""Counts that go on from another place while their joint is read."""

from dataclasses import replace

import numpy as np
import pytest

from tests.daemon.values import count_samples
from traverse.daemon.references.jumps import JumpMonitor, least_jump_rad
from traverse.drivers.base.values import STATUS_MISSING

TURN = 1 << 16
RAD = 2.0 * np.pi / TURN
PERIOD_S = 0.01  # of `count_samples`
LEAST_RAD = least_jump_rad(PERIOD_S, RAD)


class Device:
    """Two joints, of which the second rests."""

    def __init__(self):
        turns = np.array([TURN, TURN])
        self.monitor = JumpMonitor(np.array([0, 1]), turns, turns * 0.0 + RAD, 0, 20.0)
        self.n, self.jumps = 0, []

    def read(self, path_rad, late_ns=0, missing=(), *, has_clock=True):
        counts = np.rint(np.column_stack([path_rad, 0.0 * path_rad]) / RAD) % TURN
        for begin in range(0, len(counts), 7):
            first = self.n + begin
            block = count_samples(counts[begin : begin + 7], first=first)
            block = replace(block, received_ns=block.received_ns + late_ns)
            if not has_clock:
                block = replace(block, device_ticks=block.sample_time_ns)
            rows = np.isin(block.seq, missing)
            block.status[rows, 0] = STATUS_MISSING
            self.jumps += self.monitor.add(block)
        self.n += len(counts)


def swing(n=200):
    return 1.5 * np.sin(4.0 * np.arange(n) * PERIOD_S)  # 6 rad/s, 24 rad/s^2


@pytest.mark.parametrize("row", [50, 96, 97])
@pytest.mark.parametrize("by_rad", [1.5 * LEAST_RAD, 0.1, -2.0])
def test_a_count_that_goes_on_elsewhere_is_seen(row, by_rad):
    device, path_rad = Device(), swing()
    path_rad[row:] += by_rad
    device.read(path_rad)
    (jump,) = device.jumps
    assert jump.place == 0
    assert jump.by_rad == pytest.approx(by_rad, abs=LEAST_RAD)
    before = count_samples(np.zeros((row, 2)))
    assert jump.since_ns == before.sample_time_ns[-1]


def test_no_motion_excuses_a_way_that_no_joint_is_quick_enough_for():
    """A script brakes by 640 rad/s^2 while the count jumps."""
    device, path_rad = Device(), np.zeros(200)
    speeds = np.clip(16.0 - 6.4 * np.abs(np.arange(200) - 100), 0.0, None)
    path_rad += np.cumsum(speeds) * PERIOD_S
    path_rad[102:] += 0.3
    device.read(path_rad)
    assert [jump.place for jump in device.jumps] == [0]


@pytest.mark.parametrize("missing", [(), (100,), (100, 101)])
@pytest.mark.parametrize("share", [0.5, 2.0])
def test_the_least_jump_of_a_joint_at_rest(share, missing):
    device, path_rad = Device(), np.zeros(200)
    least_rad = least_jump_rad(PERIOD_S * (1 + len(missing)), RAD)
    path_rad[100:] += share * least_rad
    device.read(path_rad, missing=missing)
    assert len(device.jumps) == (share > 1.0)


def test_a_hand_a_stop_and_a_knock_are_no_jumps():
    path_rad = swing()
    for change in ("none", "stop", "knock"):
        device = Device()
        if change == "stop":
            path_rad[100:] = path_rad[100]  # against what it touches
        elif change == "knock":
            path_rad[100:] = path_rad[100] + np.linspace(0.0, 2.0, 101)[1:]
        device.read(path_rad)
        assert device.jumps == []


def test_a_wrist_that_flips_has_not_jumped():
    device, path_rad = Device(), np.cumsum(np.full(200, -0.02))
    path_rad[100:] += 0.12
    path_rad[101:] = path_rad[100] + 0.02
    device.read(path_rad)
    assert device.jumps == []


@pytest.mark.parametrize("by_rad", [0.3, 2.0])
def test_a_spoilt_reading_is_no_jump(by_rad):
    device, path_rad = Device(), swing()
    path_rad[120] += by_rad
    device.read(path_rad)
    assert device.jumps == []


@pytest.mark.parametrize(("lost", "by_rad"), [(20, 2.5), (28, 2.5), (22, 0.0)])
def test_a_gap_says_less_the_quicker_the_joint_may_be(lost, by_rad):
    device, speed_rad_s = Device(), 0.0 if by_rad else 15.0
    path_rad = speed_rad_s * PERIOD_S * np.arange(200)
    path_rad[100:] += by_rad
    device.read(path_rad, missing=tuple(range(100 - lost, 100)))
    assert len(device.jumps) == (lost == 20)


@pytest.mark.parametrize("has_clock", [True, False])
def test_a_counter_that_stood_still_has_not_jumped(has_clock):
    """It turns for half a second, of which the board knows nothing."""
    device = Device()
    device.read(np.zeros(200), has_clock=has_clock)
    device.read(np.full(200, 1.6), late_ns=500_000_000, has_clock=has_clock)
    assert len(device.jumps) == (not has_clock)  # polled: late, at times that are known
