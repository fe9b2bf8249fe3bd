"""Events of a device and its state, and which measurements it permits."""

import numpy as np

from tests.daemon.board_harness import BOARD, OTHER_BOARD, Bench
from tests.daemon.values import ARM, arm_model, count_samples, latch
from traverse.drivers.base.values import (
    DeviceAlarm,
    DeviceLost,
    DeviceTemperatures,
    DeviceUp,
)


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


async def test_a_lost_device_is_reported_once_and_cleared_once(bench):
    lost = DeviceLost("base", "unplugged", "plug it in")
    bench.take(lost)
    assert bench.codes() == []  # at start-up it is reported otherwise
    assert bench.device.answered.is_set()
    bench.take(DeviceUp("base", BOARD, False), lost, lost)
    assert bench.device.state == "lost"
    bench.take(DeviceUp("base", BOARD, False))
    states = [(event.code, event.active) for event in bench.events]
    assert states == [("device.lost", True), ("device.lost", False)]
    assert bench.device.reconnects == 1
    assert bench.changes == 5 + 5  # of the device, and of its conditions


async def test_a_restarted_board_is_told_and_the_turns_are_taken_afresh(bench):
    bench.take(DeviceUp("base", BOARD, False))
    turning = np.linspace(0, 3 * (1 << 20), 60)[:, np.newaxis] * [1, 0, 0]
    bench.take(count_samples(turning))
    bench.take(DeviceUp("base", BOARD, True), latch((0, 0, 0)))
    assert "device.restarted" in bench.codes()
    assert bench.points[0].counts[1] == 0  # not three turns on


async def test_alarms_are_raised_and_cleared_with_their_channel(bench):
    weak = ("encoder signal weak", 350)
    bench.take(
        DeviceAlarm("base", 1, True, 1, *weak),
        DeviceAlarm("base", 1, True, 1, *weak),
        DeviceAlarm("base", None, True, 6, "frames dropped", 9),
        DeviceAlarm("base", 1, False, 1, *weak),
        DeviceAlarm("base", 2, True, "node_lost", "node 5 is silent", 0, "look at it"),
    )
    reports = [(event.code, event.source, event.active) for event in bench.events]
    assert reports == [
        ("alarm.1", "base/1", True),
        ("alarm.6", "base", True),
        ("alarm.1", "base/1", False),
        ("alarm.node_lost", "base/2", True),
    ]
    # The joint is named: channel 1 is J3's, channel 2 is J1's.
    assert bench.events[0].text == "J3: encoder signal weak (value 350)"
    assert bench.events[2].text == "J3: ended: encoder signal weak"
    named = bench.events[-1]
    assert (named.text, named.remedy) == ("J1: node 5 is silent", "look at it")


WARM = """
[[effects]]
kind = "thermal_expansion"
expansion_per_c = 1e-5
"""


async def test_effects_without_a_temperature_are_reported_once_it_should_have_come(
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
    # The arm's sensor fails; another one, elsewhere, does not take its place.
    bench.take(DeviceTemperatures("base", (21.4, 43.0)))
    bench.take(DeviceTemperatures("base", (85.0, 43.0)))
    events = [e for e in bench.events if e.code == "device.temperature_unknown"]
    assert [event.active for event in events] == [True, False, True]
    assert "20 C is taken" in events[0].text
    assert "sensor" in events[0].remedy
    bench.device.driver.close()


async def test_a_device_that_returns_tells_its_temperature_anew(bench):
    bench.take(
        DeviceUp("base", BOARD, False),
        DeviceTemperatures("base", (21.5,)),
        DeviceLost("base", "unplugged", "plug it in"),
        DeviceUp("base", BOARD, False),
        latch((5, 6, 7)),
    )
    assert bench.points[0].temperature_c is None


async def test_a_sensor_that_falls_silent_leaves_no_temperature(tmp_path):
    """Its board measures on; what it said last is not the temperature for ever."""
    bench = Bench(arm_model(tmp_path, ARM + WARM))
    report = DeviceTemperatures("base", (21.5,), period_ns=2_000_000_000)
    bench.take(DeviceUp("base", BOARD, False), report)
    known_s = []
    for second in range(1, 16):
        bench.clock.now_ns += 1_000_000_000
        samples = count_samples(np.zeros((3, 3)), first=100 * second)
        bench.take(samples, latch((5, 6, 7), token=second))
        if bench.points[-1].quality.ok:
            known_s.append(second)
    assert known_s == list(range(1, 11))
    assert bench.points[-1].temperature_c is None
    assert bench.points[-1].quality.flags == ("temperature_unknown",)
    assert "device.temperature_unknown" in bench.codes()
    bench.take(report, latch((5, 6, 7), token=16))
    assert bench.points[-1].temperature_c == 21.5
    assert bench.points[-1].quality.ok
    bench.device.driver.close()


async def test_without_effects_nobody_misses_the_temperature(bench):
    bench.take(DeviceUp("base", BOARD, False))
    bench.clock.now_ns += 60 * 10**9
    bench.take(count_samples(np.zeros((3, 3))), DeviceTemperatures("base", ()))
    assert bench.codes() == []
