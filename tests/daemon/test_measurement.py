"""Points, scans and live poses out of what a board delivers."""

import asyncio

import numpy as np

from tests.daemon.board_harness import BOARD
from tests.daemon.values import count_samples, latch
from traverse.drivers.base.values import DeviceUp


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


async def test_a_refused_capture_is_reported(bench):
    bench.room = False
    bench.take(DeviceUp("base", BOARD, False), latch((5, 6, 7)))
    bench.room = True
    bench.take(latch((5, 6, 7), token=1))
    assert bench.codes().count("capture.refused") == 1
    assert [point.seq for point in bench.points] == [0]


async def test_a_latch_on_request_answers_whoever_waits(bench):
    waiting = asyncio.get_running_loop().create_future()
    bench.measurement.latches[7] = waiting, None
    bench.take(latch((5, 6, 7), number=None, token=7))
    point = await waiting
    assert (point.trigger, bench.points) == ("command", [point])
    assert bench.measurement.latches == {}


async def test_a_latch_that_comes_too_late_makes_no_point(bench):
    bench.take(latch((5, 6, 7), number=None, token=7))
    assert bench.points == []


async def test_live_poses_are_thinned_to_their_rate(bench):
    bench.take(DeviceUp("base", BOARD, False))
    for first in range(0, 100, 2):  # a second in blocks of 20 ms
        bench.take(count_samples(np.zeros((2, 3)), first=first))
    assert 19 <= len(bench.live) <= 21
    assert bench.live[0].speed_mm_s is None
    assert bench.live[1].speed_mm_s == 0.0
