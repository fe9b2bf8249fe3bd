import asyncio
import time

import numpy as np
import pytest

from traverse.drivers.base.delivery_maps import delivery_from_map, delivery_to_map
from traverse.drivers.base.delivery_queue import DeliveryQueue
from traverse.drivers.base.values import (
    CountSamples,
    DeviceAlarm,
    DeviceCounters,
    DeviceFault,
    DeviceLost,
    DeviceTemperatures,
    DeviceUp,
    Identity,
    LatchedCounts,
    RepeatedCount,
    StreamStarted,
)
from traverse.drivers.replay import ReplayDriver, ReplayOptions
from traverse.recording.maps import bytes_to_map, map_to_bytes
from traverse.recording.run_writer import Entry, RunHead, RunWriter

BOARD = Identity("board 1", "7", (1 << 20, 1 << 16), 2, 1000.0, True, (None, 65536), 9)
BEGIN_NS = 5 * 10**12


def samples(first, n=10, skew=None):
    seq = np.arange(first, first + n)
    return CountSamples(
        "base",
        1,
        seq,
        seq * 10,
        BEGIN_NS + (first + n) * 1_000_000 + 300,
        BEGIN_NS + seq * 1_000_000,
        (seq % 2).astype(np.uint8),
        np.stack([seq * 3, 70_000 - seq], axis=1).astype(np.uint32),
        np.zeros((n, 2), np.uint8),
        None if skew is None else np.full((n, 2), skew, np.int32),
    )


EDGE = LatchedCounts(
    "base", 1, True, 4, 77, BEGIN_NS + 21_000_000, BEGIN_NS + 20_500_000, (1, 2), (0, 0)
)
ASKED = LatchedCounts(
    "base",
    None,
    False,
    5,
    77,
    BEGIN_NS + 22_000_000,
    BEGIN_NS + 21_500_000,
    (1, 2),
    (0, 0),
)
DELIVERIES = (
    DeviceUp("base", BOARD, True),
    StreamStarted("base", 1, 1000.0),
    samples(0),
    samples(10, skew=2000),
    EDGE,
    ASKED,
    DeviceTemperatures("base", (None, 21.5)),
    DeviceAlarm("base", None, True, "worn", "worn", 3),
    DeviceAlarm("base", 1, False, 6, "slow", 0),
    DeviceFault("base", "samples_lost", "text", "remedy", 2),
    RepeatedCount("base", 2, 1, -1.5e-3, BEGIN_NS, BEGIN_NS + 1, False, 10**7),
    DeviceCounters("base", {"samples_received": 3}),
    DeviceLost("base", "cable", "plug it in"),
)


def same(first, other):
    """Equal, arrays bit by bit."""
    tables = [delivery_to_map(delivery) for delivery in (first, other)]
    return all(
        np.array_equal(value, tables[1][name])
        and getattr(value, "dtype", None) == getattr(tables[1][name], "dtype", None)
        if isinstance(value, np.ndarray)
        else value == tables[1][name]
        for name, value in tables[0].items()
    )


@pytest.mark.parametrize("delivery", DELIVERIES, ids=lambda d: type(d).__name__)
def test_deliveries_come_back_from_their_bytes(delivery):
    restored = delivery_from_map(bytes_to_map(map_to_bytes(delivery_to_map(delivery))))
    assert type(restored) is type(delivery)
    assert same(restored, delivery)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"kind": "sample"}, "expected samples, latch"),
        ({"kind": ["samples"]}, "expected samples, latch"),
        ({"counts": np.zeros((0, 2), np.uint32)}, "not empty"),
        ({"counts": np.zeros(10, np.uint32)}, "two dimensions"),
        ({"counts": np.zeros((10, 2), np.int64)}, "is of int64, expected uint32"),
        ({"seq": np.arange(9)}, r"seq is no array of shape \(10,\)"),
        ({"received_ns": "now"}, "received_ns is 'now'"),
    ],
)
def test_maps_that_tell_of_no_delivery_are_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        delivery_from_map({**delivery_to_map(samples(0)), **changes})
    with pytest.raises(ValueError, match="that is none"):
        delivery_from_map({"kind": "latch", "device": "base"})


def recording(path):
    with RunWriter(path, RunHead({})) as writer:
        state = {
            "devices": [delivery_to_map(DELIVERIES[0]), delivery_to_map(DELIVERIES[1])]
        }
        table = {"is": "state", "at_ns": BEGIN_NS, "value": state}
        writer.add(Entry("steps", 1, map_to_bytes(table)))
        for number, delivery in enumerate(DELIVERIES[2:]):
            table = {
                "at_ns": BEGIN_NS + number * 10_000_000,
                **delivery_to_map(delivery),
            }
            topic = f"device/base/{table['kind']}"
            writer.add(Entry(topic, 1, map_to_bytes(table)))
            other = {**table, "device": "other"}
            writer.add(Entry("device/other/x", 1, map_to_bytes(other)))
    return path


async def delivered(driver, delivery_queue, n_lost):
    deliveries = []
    with driver:
        async with asyncio.timeout(10):
            while sum(isinstance(d, DeviceLost) for d in deliveries) < n_lost:
                deliveries += await delivery_queue.take()
    return deliveries


async def test_a_device_delivers_what_it_did_then_at_the_times_of_now(tmp_path):
    delivery_queue = DeliveryQueue(asyncio.get_running_loop())
    path = recording(tmp_path / "a.mcap")
    driver = ReplayDriver(
        "arm", ReplayOptions(file=str(path), source="base", speed=2.0), delivery_queue
    )
    begun_ns = time.monotonic_ns()
    deliveries = await delivered(driver, delivery_queue, 2)
    ended_ns = time.monotonic_ns()
    assert {d.device for d in deliveries} == {"arm"}
    up, stream = (d for d in deliveries[:3] if not isinstance(d, DeviceCounters))
    assert isinstance(up, DeviceUp)
    assert (up.identity.latches, up.identity.max_rate_hz) == (False, 2000.0)
    assert stream == StreamStarted("arm", 1, 2000.0)
    blocks = [d for d in deliveries if isinstance(d, CountSamples)]
    counts = np.concatenate([b.counts for b in blocks])
    assert (counts == np.concatenate([samples(0).counts, samples(10).counts])).all()
    times_ns = np.concatenate([b.sample_time_ns for b in blocks])
    assert (np.diff(times_ns) == 500_000).all()
    assert begun_ns <= times_ns[0] <= ended_ns
    (edge,) = [d for d in deliveries if isinstance(d, LatchedCounts)]
    assert (edge.input, edge.token, edge.counts) == (1, 4, (1, 2))
    assert edge.sample_time_ns - times_ns[0] == 20_500_000 // 2
    assert any(isinstance(d, DeviceAlarm) and d.code == "worn" for d in deliveries)
    lost = [d.reason for d in deliveries if isinstance(d, DeviceLost)]
    assert lost[0] == "cable"
    assert "has ended" in lost[1]


async def test_it_begins_anew_where_it_is_requested(tmp_path):
    delivery_queue = DeliveryQueue(asyncio.get_running_loop())
    path = recording(tmp_path / "a.mcap")
    driver = ReplayDriver(
        "base", ReplayOptions(file=str(path), speed=100.0, repeat=True), delivery_queue
    )
    deliveries = await delivered(driver, delivery_queue, 4)
    assert sum(isinstance(d, DeviceUp) for d in deliveries) >= 2


@pytest.mark.parametrize(
    ("content", "message"),
    [(None, "cannot be read: No such file"), (b"no recording", "no MCAP file")],
)
async def test_a_file_that_cannot_be_played_is_reported(tmp_path, content, message):
    path = tmp_path / "a.mcap"
    if content is not None:
        path.write_bytes(content)
    delivery_queue = DeliveryQueue(asyncio.get_running_loop())
    (lost,) = await delivered(
        ReplayDriver("base", ReplayOptions(file=str(path)), delivery_queue),
        delivery_queue,
        1,
    )
    assert message in lost.reason
