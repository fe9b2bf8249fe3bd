"""Queue, ring, clock and last words of the recorder."""

import numpy as np

from tests.daemon.recorder.recorded_runs import IDENTITIES
from tests.daemon.values import SetClock
from traverse.daemon.clock import JITTER_NS, LOOK_NS, FrozenClock
from traverse.daemon.recorder.file import PreTriggerBuffer
from traverse.daemon.recorder.item_queue import WARM_UP_NS, RecorderItem, RecorderQueue
from traverse.daemon.recorder.recorder import DeviceSnapshot
from traverse.drivers.base.values import (
    CountSamples,
    DeviceAlarm,
    DeviceLost,
    DeviceTemperatures,
    DeviceUp,
    StreamStarted,
)
from traverse.recording.run_writer import Entry


def test_the_queue_is_bounded_by_items_and_bytes_but_takes_jobs():
    queue = RecorderQueue(most_items=3, most_bytes=10_000)
    samples = CountSamples(
        "a",
        1,
        np.arange(50),
        np.arange(50),
        0,
        np.arange(50),
        np.zeros(50, np.uint8),
        np.zeros((50, 7), np.uint32),
        np.zeros((50, 7), np.uint8),
    )
    assert queue.put(RecorderItem("delivered", 0, "samples", samples))
    assert queue.put(RecorderItem("delivered", 0, "samples", samples))
    assert not queue.put(RecorderItem("delivered", 0, "samples", samples))
    assert queue.put(RecorderItem("passed", 0))
    assert not queue.put(RecorderItem("passed", 0))
    assert queue.put(RecorderItem("job", 0, value=lambda: None))
    assert queue.dropped == 2
    assert len(queue.take()) == 4
    assert queue.put(RecorderItem("passed", 0))


def test_the_ring_begins_with_a_state_that_is_old_enough():
    ring = PreTriggerBuffer()
    ring.add(Entry("steps", 0, b"before any state"))
    assert not ring
    for number in range(6):
        at_ns = number * WARM_UP_NS // 2
        ring.begin_segment(at_ns)
        ring.add(Entry("steps", at_ns, b"state %d" % number))
        ring.add(Entry("cloud", at_ns, b"a scan"))
    assert list(ring) == [
        Entry("steps", number * WARM_UP_NS // 2, b"state %d" % number)
        for number in (3, 4, 5)
    ]
    small = PreTriggerBuffer(most_bytes=10)
    small.begin_segment(0)
    small.add(Entry("steps", 0, bytes(11)))
    assert not small


def test_the_last_told_deliveries_say_how_devices_are():
    last = DeviceSnapshot()
    for delivery in (
        DeviceUp("base", IDENTITIES["base"], True),
        DeviceAlarm("base", 1, True, "old", "", 0),
        DeviceLost("base", "cable", ""),
        DeviceUp("base", IDENTITIES["base"], True),
        StreamStarted("base", 1, 100.0),
        StreamStarted("base", 2, 200.0),
        DeviceAlarm("base", 1, True, "worn", "", 0),
        DeviceAlarm("base", 2, True, "gone", "", 0),
        DeviceAlarm("base", 2, False, "gone", "", 0),
        DeviceTemperatures("base", (20.0,)),
    ):
        last.note(delivery)
    maps = last.maps()
    assert [m["kind"] for m in maps] == ["up", "stream", "alarm", "temperatures"]
    assert maps[0]["restarted"] is False
    assert maps[1]["stream"] == 2
    assert maps[2]["code"] == "worn"


def test_time_stands_within_a_step_and_utc_moves_only_when_it_has_changed():
    host, reported_offsets = SetClock(), []
    clock = FrozenClock(
        host, lambda now_ns, offset_ns: reported_offsets.append((now_ns, offset_ns))
    )
    begun_ns, offset_ns = host.now_ns, host.offset_ns
    host.now_ns += 5
    assert clock.monotonic_ns() == begun_ns
    assert clock.running.monotonic_ns() == begun_ns + 5
    assert clock.step() == clock.monotonic_ns() == begun_ns + 5
    host.offset_ns += 2 * JITTER_NS
    clock.step()
    assert clock.utc_offset_ns() == offset_ns
    host.now_ns += LOOK_NS
    now_ns = clock.step()
    assert clock.to_utc_ns(0) == clock.utc_offset_ns() == offset_ns + 2 * JITTER_NS
    host.now_ns += LOOK_NS
    host.offset_ns += JITTER_NS // 2
    clock.step()
    assert reported_offsets == [(now_ns, offset_ns + 2 * JITTER_NS)]
