"""Points of an arm that no device latches as a whole."""

import asyncio
from dataclasses import replace

import numpy as np
import pytest

from tests.daemon.arm_harness import IDENTITIES, ArmBench, edge
from tests.daemon.two_devices import BEGIN_NS, base, true_counts, wrist
from tests.daemon.values import ARM, arm_model
from traverse.daemon.errors import CaptureRefusedError
from traverse.daemon.executor import TakeNow
from traverse.daemon.points.request_queue import MAX_PENDING
from traverse.drivers.base.values import DeviceLost, DeviceUp, StreamStarted
from traverse.kinematics.model.forward import probe_centre

EDGE_NS = BEGIN_NS + 123_456_789


@pytest.fixture
async def bench(arm_bench):
    return arm_bench


def true_place_mm(model, time_ns):
    """Where the ball is, by the true motion; readings go on from the zeros' turns."""
    angles_rad = true_counts(np.array([time_ns])) * model.per_count_rad
    return probe_centre(model.geometry, angles_rad)[0]


def off_mm(bench, point, time_ns):
    return np.linalg.norm(np.array(point.xyz_mm) - true_place_mm(bench.model, time_ns))


async def test_an_edge_of_a_device_without_joints_makes_a_point_at_its_instant(bench):
    bench.take(wrist().samples(range(8)), base().samples(range(12)))
    bench.take(edge("handle", EDGE_NS, 7))
    assert bench.points == []
    assert bench.acknowledged("handle") == []
    bench.take(base().samples(range(12, 20)))
    assert bench.points == []  # the wrist's readings after it have not arrived
    bench.take(wrist().samples(range(8, 14)))
    (point,) = bench.points
    assert bench.acknowledged("handle") == [7]
    assert point.trigger == "button"
    assert point.time_ns == EDGE_NS + bench.clock.offset_ns
    assert point.quality.flags == ("interpolated",)
    assert point.quality.ok
    assert off_mm(bench, point, EDGE_NS) < 0.2
    assert bench.codes().count("button.pressed") == 1


async def test_counts_that_were_latched_are_taken_and_the_rest_interpolated(bench):
    bench.take(wrist().samples(range(20)), base().samples(range(20)))
    # The base latches joints 2 and 1 a little beside its stream.
    counts = base().samples([12]).counts[0] + np.array([17, 0, 3])
    bench.take(edge("base", EDGE_NS, 3, counts=tuple(counts.tolist())))
    (point,) = bench.points
    assert (point.trigger, point.quality.flags) == ("switch", ("interpolated",))
    near = [c % t for c, t in zip(point.counts[:2], (65536, 1048576), strict=True)]
    assert near == [counts[2], counts[0]]
    per_count_rad = bench.model.per_count_rad
    exact = np.array(point.counts[:2]) * per_count_rad[:2]
    assert point.angles_rad[:2] == pytest.approx(exact, abs=1e-15)
    assert bench.acknowledged("base") == [3]


@pytest.mark.parametrize("early_ns", [30_000_000, 65_536_000])
async def test_a_time_at_which_the_counts_were_not_is_in_doubt(bench, early_ns):
    """A counter that captured the edge before its overflow was counted."""
    bench.take(wrist().samples(range(20)), base().samples(range(20)))
    counts = tuple(base().samples([12]).counts[0].tolist())
    bench.take(edge("base", EDGE_NS - early_ns, 3, counts=counts))
    (point,) = bench.points
    assert "time_uncertain" in point.quality.flags
    (event,) = [e for e in bench.events if e.code == "condition.device_clock"]
    assert "not that of its counts" in event.text


async def test_edges_keep_their_order_and_none_is_acknowledged_early(bench):
    bench.take(wrist().samples(range(8)), base().samples(range(12)))
    bench.take(edge("handle", EDGE_NS, 0))
    bench.take(edge("handle", EDGE_NS + 1_000_000, 1, active=False))
    bench.take(edge("handle", EDGE_NS + 2_000_000, 2, number=1))  # means nothing
    early = BEGIN_NS + 50_000_000  # could be made at once
    bench.take(edge("base", early, 0, counts=(1, 2, 3)))
    assert (bench.points, bench.acknowledged("handle")) == ([], [])
    assert bench.acknowledged("base") == []
    bench.take(wrist().samples(range(8, 20)), base().samples(range(12, 20)))
    assert [p.trigger for p in bench.points] == ["button", "switch"]
    assert [p.seq for p in bench.points] == [0, 1]
    assert bench.acknowledged("handle") == [0, 1, 2]
    assert bench.acknowledged("base") == [0]
    input_codes = [c for c in bench.codes() if c.startswith(("button", "switch"))]
    assert input_codes == ["button.pressed", "button.released", "switch.pressed"]


async def test_a_point_whose_readings_do_not_come_is_refused_with_the_reason(bench):
    bench.take(wrist().samples(range(8)), base().samples(range(30)))
    bench.take(edge("handle", EDGE_NS, 0))
    bench.later(0.499)
    assert "capture.refused" not in bench.codes()
    bench.later(0.002)
    (refused,) = [e for e in bench.events if e.code == "capture.refused"]
    assert "no readings of wrist arrived after it" in refused.text
    assert bench.points == []
    assert bench.capture.refused == 1
    assert bench.acknowledged("handle") == [0]  # it has been dealt with
    # The next one is taken again, without a gap in the numbers.
    bench.take(wrist().samples(range(8, 30)))
    bench.take(edge("handle", EDGE_NS, 1))
    assert [p.seq for p in bench.points] == [0]


async def test_an_edge_before_everything_that_is_known_is_refused(bench):
    bench.take(wrist().samples(range(20)), base().samples(range(20)))
    bench.take(edge("handle", BEGIN_NS - 10**9, 0))
    bench.later(0.6)
    (refused,) = [e for e in bench.events if e.code == "capture.refused"]
    assert "older than the readings of base that are kept" in refused.text


async def test_no_more_edges_wait_than_there_is_room_for(bench):
    bench.take(base().samples(range(8)))
    for token in range(MAX_PENDING + 3):
        bench.take(edge("handle", EDGE_NS, token))
    assert bench.acknowledged("handle") == [0, 1, 2]
    assert bench.capture.refused == 3


async def test_a_command_takes_a_point_out_of_the_stream(bench):
    bench.take(wrist().samples(range(8)), base().samples(range(8)))
    bench.clock.now_ns = EDGE_NS
    answer = bench.measurement.points.take_now()
    assert not answer.done()
    bench.take(wrist().samples(range(8, 14)), base().samples(range(8, 14)))
    point = await answer
    assert point.trigger == "command"
    assert point.time_ns == EDGE_NS + bench.clock.offset_ns
    assert off_mm(bench, point, EDGE_NS) < 0.2


async def test_a_command_that_cannot_be_carried_out_says_why(bench):
    bench.take(wrist().samples(range(8)))
    answer = bench.measurement.points.take_now()
    bench.later(0.6)
    with pytest.raises(CaptureRefusedError, match="base has not read all its joints"):
        await answer


async def test_whoever_gave_up_finds_no_point_later(bench):
    bench.take(wrist().samples(range(8)), base().samples(range(8)))
    bench.clock.now_ns = EDGE_NS
    answer = bench.measurement.points.take_now()
    answer.cancel()
    bench.take(wrist().samples(range(8, 14)), base().samples(range(8, 14)))
    assert bench.points == []
    assert bench.capture.refused == 0


async def test_a_lost_device_and_its_return_neither_lose_nor_double_an_edge(bench):
    bench.take(wrist().samples(range(8)), base().samples(range(12)))
    bench.take(edge("handle", EDGE_NS, 0))
    bench.take(DeviceLost("wrist", "unplugged", "plug it in"))
    bench.later(0.1)
    assert bench.acknowledged("handle") == []
    bench.take(DeviceUp("wrist", IDENTITIES["wrist"], False))
    bench.take(StreamStarted("wrist", 2, 80.0))
    back = wrist(stream=2, first_ns=BEGIN_NS + 200_000_000)
    bench.take(back.samples(range(5)), base().samples(range(12, 30)))
    (point,) = bench.points  # published, with what it lacks
    assert point.quality.flags == ("incomplete", "interpolated", "skew")
    assert bench.acknowledged("handle") == [0]
    assert bench.codes().count("button.pressed") == 1


async def test_a_device_without_power_costs_the_turns_of_its_own_joints_only(bench):
    bench.take(wrist().samples(range(120)), base().samples(range(140)))
    before = whole_turns(bench)
    # By now the base has turned on, by more than it would be put back to.
    bench.measurement.pipeline._unwrapper._last += bench.model.encoders.counts_per_turn
    bench.take(DeviceUp("wrist", IDENTITIES["wrist"], True))
    bench.take(StreamStarted("wrist", 2, 80.0))
    later = wrist(stream=2, first_ns=BEGIN_NS + 1_500_000_000)
    bench.take(later.samples(range(80)))
    for first in range(140, 240, 5):
        bench.take(base().samples(range(first, first + 5)))
    assert (whole_turns(bench) - before).tolist() == [1, 1, 0]
    assert "device.restarted" in bench.codes()


def whole_turns(bench):
    live = bench.live[-1]
    last_ns = live.time_ns - bench.clock.offset_ns
    true_rad = true_counts(np.array([last_ns]))[0] * np.abs(bench.model.per_count_rad)
    shown_rad = np.array(live.angles_rad) * bench.model.encoders.signs
    turns = (shown_rad - true_rad) / (2 * np.pi)
    assert np.abs(turns - np.rint(turns)).max() < 1e-3
    return np.rint(turns).astype(int)


async def test_samples_of_both_make_live_poses_and_what_lacks_is_reported_once(bench):
    bench.take(wrist().samples(range(40)), base().samples(range(40)))
    (live,) = bench.live[-1:]
    assert live.quality.flags == ("interpolated",)
    last_ns = live.time_ns - bench.clock.offset_ns
    assert off_mm(bench, live, last_ns) < 0.2
    assert bench.measurement.skew.pop_largest_mm() < 0.1
    assert bench.measurement.skew.pop_largest_mm() is None
    bench.take(base().samples(range(40, 60)))
    bench.later(0.06)
    assert bench.live[-1].quality.flags == ("incomplete", "skew")
    bench.take(base().samples(range(60, 70)))
    bench.later(0.06)
    begun = [e for e in bench.events if e.code == "device.incomplete"]
    assert [(e.active, e.source) for e in begun] == [(True, "wrist")]
    assert bench.measurement.resampler.lacks()["wrist"]["samples_incomplete"] > 10
    late = BEGIN_NS + 800_000_000
    bench.take(replace_stream(wrist(), 2, late).samples(range(200)))
    bench.take(replace_stream(base(), 2, late).samples(range(200)))
    bench.later(0.9)
    bench.later(0.2)
    ended = [e for e in bench.events if e.code == "device.incomplete"][1:]
    assert [(e.active, e.source) for e in ended] == [(False, "wrist")]


def replace_stream(reader, stream, first_ns):
    reader.stream, reader.first_ns = stream, first_ns
    return reader


async def test_the_arm_that_is_asked_to_stream_is_asked_what_each_can(bench):
    bench.measurement.joint_devices.request_stream(100.0)
    rates = {name: d.driver.rates_hz for name, d in bench.devices.items()}
    assert rates == {"base": [100.0], "wrist": [80.0], "handle": []}


async def test_a_device_of_another_resolution_measures_nothing(tmp_path):
    bench = ArmBench(tmp_path)
    bench.up("base", "handle")
    other = replace(IDENTITIES["wrist"], counts_per_turn=(None, 4096))
    bench.take(DeviceUp("wrist", other, False), StreamStarted("wrist", 1, 80.0))
    (mismatch,) = [e for e in bench.events if e.code == "device.mismatch"]
    assert "reports 4096" in mismatch.text
    assert mismatch.source == "wrist"
    assert "set the device up for it" in mismatch.remedy
    bench.take(wrist().samples(range(40)), base().samples(range(40)))
    bench.take(edge("handle", EDGE_NS, 0))
    assert (bench.live, bench.points) == ([], [])
    assert "wrist does not fit the arm file" in bench.events[-2].text
    assert bench.acknowledged("handle") == [0]
    bench.close()


async def test_one_device_that_latches_all_is_passed_on_bit_for_bit(tmp_path):
    """With a button elsewhere, points at it are interpolated; the stream is not."""
    model = arm_model(tmp_path, ARM)
    bench = ArmBench(tmp_path, model)
    whole = base(channels=(1, 2, 0))
    counts = tuple(whole.samples([12]).counts[0].tolist())
    latching = ArmBench(tmp_path, model)
    for arm_bench in (bench, latching):
        arm_bench.up("base")
        arm_bench.take(whole.samples(range(30)))
        arm_bench.take(edge("base", EDGE_NS, 0, counts=counts))
    assert [p.quality.flags for p in bench.points] == [()]
    assert bench.live[-1].quality.flags == ()
    bench.take(edge("handle", EDGE_NS, 0))
    assert bench.points[1].quality.flags == ("interpolated",)
    assert off_mm(bench, bench.points[1], EDGE_NS) < 0.3
    assert latching.points[0].xyz_mm == bench.points[0].xyz_mm
    assert latching.live[-1].xyz_mm == bench.live[-1].xyz_mm
    assert bench.measurement.resampler.lacks() == {}
    assert (
        bench.measurement.skew.pop_largest_mm() is not None
    )  # of the interpolated point
    bench.close()
    latching.close()


async def test_nothing_is_remembered_where_nothing_will_be_interpolated(tmp_path):
    model = arm_model(tmp_path, ARM)
    bench = ArmBench(tmp_path, model)
    bench.measurement._keeps_readings = False
    assert not bench.measurement.may_wait
    bench.up("base")
    bench.take(base(channels=(1, 2, 0)).samples(range(30)))
    assert bench.measurement.resampler.at(EDGE_NS, None) is None
    assert not bench.measurement.may_wait
    not_latching = replace(IDENTITIES["base"], latches=False)
    bench.take(DeviceUp("base", not_latching, False))
    assert bench.measurement.may_wait
    bench.close()


async def test_a_device_that_cannot_latch_gives_points_out_of_its_stream(tmp_path):
    bench = ArmBench(tmp_path, arm_model(tmp_path, ARM))
    not_latching = replace(IDENTITIES["base"], latches=False)
    bench.take(DeviceUp("base", not_latching, False), StreamStarted("base", 1, 100.0))
    bench.take(base(channels=(1, 2, 0)).samples(range(30)))
    bench.take(edge("base", EDGE_NS, 4))
    assert [p.trigger for p in bench.points] == ["switch"]
    assert off_mm(bench, bench.points[0], EDGE_NS) < 0.3
    assert bench.acknowledged("base") == [4]
    await asyncio.sleep(0)
    bench.close()


def late_readings(reader, numbers, late):
    """Samples of a reader; the instants of some of them are open by 10 ms."""
    samples = reader.samples(numbers)
    bounds_ns = np.zeros(samples.counts.shape, np.int32)
    bounds_ns[np.isin(samples.seq, late)] = 10_000_000
    return replace(samples, skew_bound_ns=bounds_ns)


async def test_a_commanded_point_is_one_whose_joints_are_known_at_one_instant(bench):
    """An exchange that took long leaves the place to the readings after it."""
    bench.take(wrist().samples(range(10)), base().samples(range(12)))
    asked_ns = bench.clock.now_ns = BEGIN_NS + 115_000_000
    answer = asyncio.ensure_future(TakeNow().execute(bench.measurement))
    await asyncio.sleep(0)
    bench.take(wrist().samples(range(10, 12)))
    bench.clock.now_ns += 20_000_000
    bench.take(late_readings(base(), range(12, 14), late=(12,)))
    assert bench.points == []
    bench.take(wrist().samples(range(12, 14)), base().samples(range(14, 20)))
    (point,) = bench.points
    assert point.quality.flags == ("interpolated",)
    later_ns = point.time_ns - bench.clock.offset_ns
    assert later_ns == asked_ns + 20_000_000
    assert off_mm(bench, point, later_ns) < 0.2
    assert (await answer) == point


async def test_a_commanded_point_that_stays_skewed_is_marked(bench):
    bench.take(wrist().samples(range(10)), base().samples(range(12)))
    bench.clock.now_ns = BEGIN_NS + 115_000_000
    answer = asyncio.ensure_future(TakeNow().execute(bench.measurement))
    await asyncio.sleep(0)
    for first in range(10, 30, 2):
        numbers = range(first + 2, first + 4)
        bench.clock.now_ns += 20_000_000
        bench.take(wrist().samples(range(first, first + 2)))
        bench.take(late_readings(base(), numbers, late=numbers))
    (point,) = bench.points
    assert point.quality.flags == ("interpolated", "skew")
    assert (await answer) == point


async def test_a_skewed_live_pose_leaves_its_place_to_the_next_for_a_period(bench):
    numbers = range(200)
    bench.take(wrist().samples(range(170)))
    bench.take(late_readings(base(), numbers[:100], late=numbers[:100:3]))
    assert not [live for live in bench.live if "skew" in live.quality.flags]
    n_before = len(bench.live)
    bench.take(late_readings(base(), numbers[100:], late=numbers[100:]))
    after = bench.live[n_before:]
    assert all("skew" in live.quality.flags for live in after[1:])
