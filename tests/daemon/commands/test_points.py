"""Commands about points: means, undo, labels, sessions, in order with the edges."""

import asyncio
from dataclasses import replace

import numpy as np
import pytest

from tests.daemon.arm_harness import edge
from tests.daemon.two_devices import BEGIN_NS
from traverse.daemon.errors import CaptureRefusedError, RequestRefusedError
from traverse.drivers.base.values import DeviceLost
from traverse.protocol.messages import (
    CovarianceArgs,
    LabelArgs,
    PointArgs,
    Reading,
    SessionArgs,
    UndoArgs,
)


@pytest.fixture
async def bench(arm_bench):
    arm_bench.stream(0, 40)
    return arm_bench


def press(bench, at_samples, token=0):
    bench.take(edge("handle", BEGIN_NS + int(at_samples * 1e7), token))


async def asked(command):
    task = asyncio.create_task(command)
    await asyncio.sleep(0)
    return task


async def test_a_mean_is_taken_of_the_samples_that_come(bench):
    asking = await asked(bench.point_requests.take_point(PointArgs(samples=20)))
    bench.stream(40, 55)
    assert bench.points == []
    bench.stream(55, 70)
    result = await asking
    (point,) = bench.points
    assert (result["samples"], result["seq"], result["id"]) == (20, 0, point.id)
    assert (point.samples, point.trigger) == (20, "command")
    assert point.spread_mm == pytest.approx(0.0, abs=1e-4)
    middle_ns = BEGIN_NS + int((39 + 58) / 2 * 1e7)
    assert point.time_ns == middle_ns + bench.clock.offset_ns
    assert point.covariance_mm2 is not None


async def test_readings_share_what_points_of_the_same_place_do(bench):
    asking = await asked(bench.point_requests.take_point(PointArgs(samples=20)))
    bench.stream(40, 70)
    await asking
    (point,) = bench.points
    covariance = bench.point_requests.covariance
    of_point = await covariance(CovarianceArgs(ids=(point.id,)))
    reading = Reading(angles_rad=point.angles_rad, utc_s=point.time_ns * 1e-9)
    asked_for = CovarianceArgs(model=point.model, readings=(reading, reading))
    of_readings = await covariance(asked_for)
    assert of_readings["with_arm"] is of_point["with_arm"] is True
    (first, second), (shared,) = (
        of_readings["shared_mm"],
        [p["shared_mm"] for p in of_point["points"]],
    )
    assert first == second
    np.testing.assert_allclose(first, shared, rtol=1e-9, atol=1e-12)
    with pytest.raises(RequestRefusedError, match="not of the arm file and probe"):
        await covariance(CovarianceArgs(model="sha256:other", readings=(reading,)))
    with pytest.raises(ValueError, match="ids, or else readings"):
        CovarianceArgs(ids=("a",), readings=(reading,), model="m")


async def test_a_mean_over_a_time_has_all_samples_of_it(bench):
    asking = await asked(bench.point_requests.take_point(PointArgs(dwell_s=0.2)))
    bench.stream(40, 62)
    assert (await asking)["samples"] == 21  # 0.2 s of 100 Hz, both ends


async def test_a_mean_is_refused_at_once_while_the_arm_moves(bench):
    bench.stream(40, 60, speed=1.0)
    with pytest.raises(
        RequestRefusedError, match="mm/s when samples were to be"
    ) as refusal:
        await bench.point_requests.take_point(PointArgs(samples=10))
    assert refusal.value.code == "capture.refused"
    assert bench.codes().count("capture.refused") == 1
    assert (bench.capture.refused, bench.points) == (1, [])


async def test_an_arm_that_begins_to_move_is_refused_its_mean(bench):
    asking = await asked(bench.point_requests.take_point(PointArgs(samples=20)))
    bench.stream(40, 45)
    bench.stream(45, 70, speed=1.0)
    with pytest.raises(RequestRefusedError, match=r"moved at|spread by"):
        await asking
    assert bench.points == []


async def test_edges_during_a_mean_wait_for_their_turn_and_keep_their_place(bench):
    asking = await asked(bench.point_requests.take_point(PointArgs(samples=20)))
    bench.stream(40, 45)
    press(bench, 42.5, token=7)
    assert (bench.points, bench.acknowledged("handle")) == ([], [])
    bench.stream(45, 70)
    await asking
    assert [p.trigger for p in bench.points] == ["command", "button"]
    assert [p.seq for p in bench.points] == [0, 1]
    pressed_ns = BEGIN_NS + 425_000_000 + bench.clock.offset_ns
    assert bench.points[1].time_ns == pressed_ns
    assert bench.acknowledged("handle") == [7]


async def test_more_edges_than_a_board_keeps_end_a_mean(bench):
    asking = await asked(bench.point_requests.take_point(PointArgs(samples=20)))
    bench.stream(40, 45)
    for token in range(12):
        press(bench, 41.5, token)
    with pytest.raises(RequestRefusedError, match="too many edges"):
        await asking
    assert len(bench.points) == 12
    assert bench.acknowledged("handle") == list(range(12))


async def test_a_stream_that_stops_ends_a_mean_with_the_reason(bench):
    asking = await asked(bench.point_requests.take_point(PointArgs(samples=20)))
    bench.stream(40, 45)
    bench.take(DeviceLost("base", "gone", "plug it in"))
    bench.later(1.0)
    with pytest.raises(RequestRefusedError, match="averaged of 20, then"):
        await asking


async def test_too_many_samples_for_a_minute_are_refused(bench):
    with pytest.raises(RequestRefusedError, match="longer than 60 s") as refusal:
        await bench.point_requests.take_point(PointArgs(samples=6001))
    assert refusal.value.code == "command.bad_args"


async def test_undo_takes_back_point_after_point_and_deletes_none(bench):
    for at_samples in (30.5, 31.5, 32.5):
        press(bench, at_samples)
    first, second, third = bench.points
    reply = await bench.point_requests.undo(UndoArgs())
    again = await bench.point_requests.undo(UndoArgs(id=second.id))
    assert (reply["retracts"], again["retracts"]) == (third.id, second.id)
    retraction = bench.points[3]
    assert (retraction.seq, retraction.id) == (3, reply["id"])
    changed_keys = {"seq", "id", "retracts", "time_ns", "trigger"}
    assert retraction.model_dump(exclude=changed_keys) == third.model_dump(
        exclude=changed_keys
    )
    press(bench, 33.5)
    await bench.point_requests.undo(UndoArgs())
    assert bench.points[-1].retracts == bench.points[-2].id
    await bench.point_requests.undo(UndoArgs())
    assert bench.points[-1].retracts == first.id
    with pytest.raises(RequestRefusedError, match="no point that could be taken back"):
        await bench.point_requests.undo(UndoArgs())
    assert [p.seq for p in bench.points] == list(range(8))
    assert bench.capture.retracted == 4


async def test_undo_of_a_point_that_is_not_the_last_is_refused(bench):
    press(bench, 30.5)
    press(bench, 31.5)
    with pytest.raises(
        RequestRefusedError, match=rf"retracted is {bench.points[1].id}, not"
    ):
        await bench.point_requests.undo(UndoArgs(id=bench.points[0].id))
    assert len(bench.points) == 2


async def test_undo_concerns_a_point_that_was_requested_and_still_waits(bench):
    press(bench, 30.5)
    press(bench, 45.5)  # its readings have not arrived
    undoing = await asked(bench.point_requests.undo(UndoArgs()))
    assert not undoing.done()
    bench.stream(40, 50)
    reply = await undoing
    assert reply["retracts"] == bench.points[1].id
    assert [p.retracts for p in bench.points] == [None, None, bench.points[1].id]


async def test_labels_go_to_the_points_that_were_requested_after_them(bench):
    press(bench, 45.5, 0)
    setting = await asked(
        bench.point_requests.label(LabelArgs(artefact="bar", feature="2"))
    )
    press(bench, 46.5, 1)
    bench.stream(40, 50)
    assert await setting == {"label": {"artefact": "bar", "feature": "2"}}
    await bench.point_requests.label(LabelArgs())
    press(bench, 47.5, 2)
    labels = [(p.label.artefact, p.label.feature) for p in bench.points]
    assert labels == [(None, None), ("bar", "2"), (None, None)]
    assert bench.codes().count("capture.label") == 2


async def test_a_new_session_numbers_from_0_and_cannot_undo_the_old(bench):
    press(bench, 30.5)
    await bench.point_requests.label(LabelArgs(artefact="bar"))
    bench.statuses.clear()
    result = await bench.point_requests.begin_session(
        SessionArgs(action="new", note="part 12")
    )
    assert [session for session, _ in bench.statuses] == [result["session"]]
    with pytest.raises(RequestRefusedError, match="this session has no point"):
        await bench.point_requests.undo(UndoArgs())
    press(bench, 31.5)
    old, new = bench.points
    assert (old.seq, new.seq, new.session) == (0, 0, result["session"])
    assert old.session != new.session
    assert old.id != new.id
    assert new.label.artefact is None
    texts = [e.text for e in bench.events if e.code == "capture.session"]
    assert texts == [f"session {new.session} begins: part 12"]


async def test_no_room_for_a_retraction_uses_no_number(bench):
    press(bench, 30.5)
    bench.room = False
    with pytest.raises(RequestRefusedError, match="so many points wait for the disk"):
        await bench.point_requests.undo(UndoArgs())
    bench.room = True
    assert (await bench.point_requests.undo(UndoArgs()))["seq"] == 1


async def test_a_command_that_was_given_up_takes_no_point(bench):
    asking = await asked(bench.point_requests.take_point(PointArgs(samples=20)))
    asking.cancel()
    await asyncio.sleep(0)
    bench.stream(40, 70)
    assert bench.points == []
    press(bench, 60.5)
    assert len(bench.points) == 1


async def test_points_carry_the_pose_of_their_instant_not_of_their_turn(bench):
    """An edge that waits behind a mean is evaluated on arrival."""
    model = bench.model
    asking = await asked(bench.point_requests.take_point(PointArgs(samples=20)))
    bench.stream(40, 45)
    press(bench, 42.5, token=7)
    other = replace(model, digest="f" * 64)
    bench.measurement.pipeline.model = other
    bench.stream(45, 70)
    await asking
    assert [p.model for p in bench.points] == [other.digest, model.digest]


async def test_a_fault_in_one_request_does_not_hold_up_the_others(bench):
    def fail():
        raise ZeroDivisionError

    failing = bench.measurement.points.in_order(fail)
    with pytest.raises(CaptureRefusedError, match="ZeroDivisionError"):
        await failing
    press(bench, 30.5, token=3)
    assert len(bench.points) == 1
    assert bench.acknowledged("handle") == [3]
