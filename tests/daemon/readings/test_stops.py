"""Joints that stop dead, and joints that brake, in readings one after the other.

Expected by hand: who brakes with 7.5 rad/s^2 at most covers 7.5 t^2 / 2 within the last
step t, and comes to rest from 7.5 t.
"""

import numpy as np
import pytest

from traverse.daemon.acquisition.interpolation import EncoderReadings
from traverse.daemon.acquisition.joint_stream import series_of
from traverse.daemon.readings.stops import Window, stopped_joints
from traverse.drivers.base.values import STATUS_MISSING

COUNT_RAD = 2.0 * np.pi / (1 << 24)  # next to nothing
STEP_S = 0.03  # of readings at 33 Hz
LAST = 40  # reading of the joint before it stops
SKEWS_S = 0.007 * np.arange(3)  # when each joint is read
ROWS = 60


class Line:
    """Readings of three joints on one line; the first one stops."""

    def __init__(self, speed_rad_s, step_s=STEP_S, *, others_rad_s=(-0.7, 0.9)):
        self.times_s = step_s * np.arange(ROWS)[:, None] + SKEWS_S * step_s / STEP_S
        self.rad = self.times_s * [speed_rad_s, *others_rad_s]
        self.speed_rad_s, self.step_s = speed_rad_s, step_s
        self.status = np.zeros(self.rad.shape, np.uint8)
        self.bound_s = 0.0

    def freeze(self, share):
        """Freeze the first count a share of a step after the reading `LAST`."""
        self.rad[:, 0] = np.minimum(
            self.rad[:, 0], self.rad[LAST, 0] + share * self.speed_rad_s * self.step_s
        )
        return self

    def brake(self, share, rad_s2):
        from_s = self.times_s[LAST, 0] + share * self.step_s
        lasts_s = self.speed_rad_s / rad_s2
        braked_s = np.clip(self.times_s[:, 0] - from_s, 0.0, lasts_s)
        moved_s = np.minimum(self.times_s[:, 0], from_s)
        moved_s += braked_s * (1.0 - braked_s / lasts_s / 2.0)
        self.rad[:, 0] = self.speed_rad_s * moved_s
        return self

    def stopped(self, count_rad=COUNT_RAD):
        times_ns = np.rint(self.times_s * 1e9).astype(np.int64)
        readings = EncoderReadings(
            times_ns,
            np.rint(self.rad / count_rad).astype(np.int64),
            self.status,
            np.arange(ROWS),
            np.full(times_ns.shape, round(self.bound_s * 1e9)),
        )
        now_ns = int(times_ns[-1].max())
        series = series_of(np.arange(3), readings, now_ns)
        found = stopped_joints(Window(series, np.full(3, count_rad)))
        return {joint: now_ns * 1e-9 + before_s for joint, before_s in found}


@pytest.mark.parametrize("share", [0.02, 0.2, 0.323, 0.5, 0.8, 0.98])
def test_a_quick_joint_is_seen_to_freeze_whenever_it_does(share):
    # 7.5 (0.03 / 2 + 0.03) = 0.3375 rad/s, and something for rounding.
    stopped = Line(0.345).freeze(share).stopped()
    assert stopped == {0: pytest.approx(Line(0.0).times_s[LAST, 0])}


@pytest.mark.parametrize(
    ("share", "is_seen"),
    [
        # In the last step 0.72 mrad: 0.1125 + root(15 x 0.00072) = 0.216 rad/s is the
        # most from which that suffices to stop.
        (0.1, True),
        # 2.30 mrad suffice from 0.298 rad/s.
        (0.32, False),
        # 3.31 mrad: less than 7.5 x 0.03^2 / 2 = 3.375 mrad.
        (0.46, False),
        # 5.04 mrad.
        (0.7, True),
    ],
)
def test_a_slower_joint_is_seen_by_its_way_in_the_last_step(share, is_seen):
    assert bool(Line(0.24).freeze(share).stopped()) == is_seen
    # Below 7.5 x 0.03 rad/s nothing is said: a knock moves it as far.
    assert Line(0.22).freeze(share).stopped() == {}


@pytest.mark.parametrize("rad_s2", [2.0, 5.0, 7.4])
@pytest.mark.parametrize("step_s", [0.01, STEP_S, 0.1])
@pytest.mark.parametrize("bits", [14, 16, 24])
def test_a_joint_that_brakes_is_not_said_to_freeze(rad_s2, step_s, bits):
    for speed_rad_s in (0.2, 0.5, 1.0, 2.0):
        for share in np.linspace(0.0, 0.95, 20):
            line = Line(speed_rad_s, step_s).brake(share, rad_s2)
            assert line.stopped(2.0 * np.pi / (1 << bits)) == {}


def test_a_joint_that_is_knocked_between_two_readings_only_rests():
    line = Line(0.0)
    line.rad[LAST:, 0] = 0.03  # 1 rad/s, from rest to rest
    assert line.stopped() == {}
    line.rad[LAST - 1, 0] = 0.02
    assert line.stopped() == {}


def test_instants_that_may_be_off_need_more_speed():
    line = Line(0.36).freeze(0.3)
    assert line.stopped()
    line.bound_s = 0.003  # 7.5 (0.036 / 2 + 0.036) = 0.405 rad/s
    assert not line.stopped()


def test_readings_that_are_left_out_do_not_hide_it():
    line = Line(1.0).freeze(0.5)
    line.status[LAST + 3, 0] = STATUS_MISSING
    line.rad[LAST + 3, 0] = 0.0
    line.status[LAST - 5, 1] = STATUS_MISSING
    assert list(line.stopped()) == [0]


def test_an_arm_that_stops_as_a_whole_only_rests():
    line = Line(1.0).freeze(0.5)
    for joint in (1, 2):
        line.rad[LAST + 1 :, joint] = line.rad[LAST + 1, joint]
    assert line.stopped() == {}
