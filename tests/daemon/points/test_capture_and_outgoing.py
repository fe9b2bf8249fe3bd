import asyncio

import numpy as np
import pytest

from tests.daemon.values import UTC_OFFSET_NS, SetClock, arm_model, kept_at_once
from traverse.daemon.config.schema import CaptureSection, InputSection
from traverse.daemon.errors import CaptureRefusedError
from traverse.daemon.monitoring.events import Occurrence
from traverse.daemon.mqtt.message_publisher import MessagePublisher
from traverse.daemon.mqtt.outgoing_queue import (
    MAX_EVENTS,
    MAX_REPLIES,
    OutgoingMessage,
    OutgoingQueue,
)
from traverse.daemon.points.capture import Capture, PointMeasurement, triggers_of
from traverse.daemon.pose.poses import LatchedPose
from traverse.kinematics.effects.base.block import Block


def message(name: str, **options) -> OutgoingMessage:
    return OutgoingMessage(name, b"", **options)


def sent_order(queue: OutgoingQueue, n: int) -> list[str]:
    order = []
    for _ in range(n):
        kind, message = queue.next()
        queue.done(kind, message)
        order.append(message.topic)
    return order


@pytest.fixture
def model(tmp_path):
    return arm_model(tmp_path)


def pose(quality: int = 0) -> LatchedPose:
    return LatchedPose(
        10**12,
        np.array([1, -2, 3]),
        np.array([0.1, 0.2, 0.3]),
        np.array([10.0, 20.0, 30.0]),
        np.array([0.0, 0.0, 1.0]),
        quality,
        Block(np.array([[0.1, 0.2, 0.3]])),
    )


def test_a_point_says_what_was_latched(model):
    taken = []
    capture = Capture(SetClock(), kept_at_once(lambda point: not taken.append(point)))
    point = capture.take(PointMeasurement(model, pose(quality=1), 21.5), "button").point
    assert taken == [point]
    assert (point.seq, point.trigger, point.temperature_c) == (0, "button", 21.5)
    assert point.time_ns == UTC_OFFSET_NS + 10**12
    assert point.xyz_mm == (10.0, 20.0, 30.0)
    assert point.counts == (1, -2, 3)
    assert point.model == model.digest
    assert (point.quality.ok, point.quality.flags) == (False, ("encoder_error",))
    assert point.session in point.id


def test_a_refused_point_uses_no_number(model):
    room = [True, False, False, True]
    capture = Capture(SetClock(), kept_at_once(lambda point: room.pop(0)))
    points = [capture.take(PointMeasurement(model, pose(), None), "command").point]
    for _ in range(2):
        with pytest.raises(
            CaptureRefusedError, match="so many points wait for the disk"
        ):
            capture.take(PointMeasurement(model, pose(), None), "command")
    points.append(capture.take(PointMeasurement(model, pose(), None), "command").point)
    assert [point.seq for point in points] == [0, 1]
    assert capture.captured == 2
    assert len({point.id for point in points}) == 2


def test_only_wired_inputs_trigger():
    inputs = (
        InputSection(source="base/0", trigger="button"),
        InputSection(source="base/1", trigger="switch"),
    )
    triggers = triggers_of(CaptureSection(inputs=inputs))
    assert triggers == {("base", 0): "button", ("base", 1): "switch"}


async def test_a_full_queue_refuses_points_and_drops_none():
    queue = OutgoingQueue(max_points=2)
    assert queue.offer("point", message("a"))
    assert queue.offer("point", message("b"))
    assert not queue.offer("point", message("c"))
    assert queue.dropped["point"] == 0
    assert sent_order(queue, 2) == ["a", "b"]
    assert queue.offer("point", message("d"))


async def test_what_matters_most_is_sent_first():
    queue = OutgoingQueue()
    for kind in ("health", "live", "scan", "event", "point", "reply", "status"):
        queue.offer(kind, message(kind))
    queue.offer("point", message("point 2"))
    assert sent_order(queue, 8) == [
        "status",
        "reply",
        "point",
        "point 2",
        "event",
        "scan",
        "live",
        "health",
    ]


async def test_a_message_stays_until_it_is_done():
    sent_messages = []
    queue = OutgoingQueue()
    queue.offer("point", message("a", sent=lambda: sent_messages.append("a")))
    first = queue.next()
    assert queue.next() is None
    queue.take_back()  # the connection broke meanwhile
    assert queue.next() == first
    assert (sent_messages, queue.waiting("point")) == ([], 1)
    queue.done(*first)
    assert (sent_messages, queue.waiting("point")) == (["a"], 0)
    assert queue.sent["point"] == 1


async def test_live_poses_are_thinned_to_the_latest_and_counted():
    queue = OutgoingQueue()
    for k in range(5):
        assert queue.offer("live", message(str(k)))
    assert queue.dropped["live"] == 4
    assert sent_order(queue, 1) == ["4"]


async def test_a_newer_pose_is_not_lost_while_the_older_is_being_sent():
    queue = OutgoingQueue()
    queue.offer("live", message("old"))
    sending = queue.next()
    queue.offer("live", message("new"))
    queue.done(*sending)
    assert sent_order(queue, 1) == ["new"]


@pytest.mark.parametrize(
    ("kind", "limit"), [("event", MAX_EVENTS), ("reply", MAX_REPLIES), ("scan", 3)]
)
async def test_events_replies_and_scans_are_dropped_newest_first(kind, limit):
    queue = OutgoingQueue(max_scan_blocks=3)
    offered = [queue.offer(kind, message(str(k))) for k in range(limit + 2)]
    assert offered == [True] * limit + [False] * 2
    assert queue.dropped[kind] == 2
    assert sent_order(queue, limit) == [str(k) for k in range(limit)]


async def test_what_is_not_urgent_is_sent_with_the_next_or_at_a_flush():
    queue, looked = OutgoingQueue(), []
    kinds = "event", "point"
    with queue.notifying(lambda: looked.append([*map(queue.waiting, kinds)])):
        queue.offer("event", message("a"), at_once=False)
        queue.offer("event", message("b"), at_once=False)
        assert looked == []
        queue.offer("point", message("c"))
        assert looked == [[2, 1]]
        queue.offer("event", message("d"), at_once=False)
        queue.flush()
    queue.offer("point", message("e"))  # its requester has gone
    assert looked == [[2, 1], [3, 1]]


@pytest.mark.parametrize(
    ("severity", "active", "looked_at"),
    [("info", None, 0), ("info", False, 1), ("warning", None, 1), ("error", True, 1)],
)
async def test_what_informs_only_waits_for_another_message(severity, active, looked_at):
    queue, looked = OutgoingQueue(), []
    publisher = MessagePublisher("bench-7", "json", queue, SetClock())
    event = Occurrence(severity, "a.b", "text", "", "a", active, 1, 2, 1, {})
    with queue.notifying(lambda: looked.append(None)):
        publisher.publish_event(event, "session")
    assert (len(looked), queue.waiting("event")) == (looked_at, 1)


async def test_empty_waits_until_the_last_message_is_there():
    queue = OutgoingQueue()
    queue.offer("point", message("a"))
    queue.offer("event", message("b"))
    waiting = asyncio.create_task(queue.empty())
    assert sent_order(queue, 1) == ["a"]
    on_the_way = queue.next()
    await asyncio.sleep(0)
    assert not waiting.done()
    queue.done(*on_the_way)
    await waiting
    await queue.empty()


async def test_what_was_on_its_way_is_sent_again_in_order():
    queue = OutgoingQueue(max_points=4)
    for name in "abcd":
        assert queue.offer("point", message(name))
    first, second, third = (queue.next() for _ in range(3))
    queue.done(*second)  # answered out of turn
    assert queue.waiting("point") == 3
    assert queue.offer("point", message("e"))
    assert not queue.offer("point", message("f"))
    queue.take_back()
    assert sent_order(queue, 4) == ["a", "c", "d", "e"]
    assert (first[1].topic, third[1].topic) == ("a", "c")


async def test_a_pose_that_was_on_its_way_gives_way_to_a_newer_one():
    queue = OutgoingQueue()
    queue.offer("live", message("old"))
    queue.next()
    queue.offer("live", message("new"))
    queue.take_back()
    assert sent_order(queue, 1) == ["new"]
    assert queue.next() is None
