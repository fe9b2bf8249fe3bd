"""The ring of cycles and the files of it."""

import gc
import json
from dataclasses import replace

import numpy as np
import pytest

from tests.daemon.values import UTC_OFFSET_NS, SetClock, count_samples
from traverse.daemon.monitoring.latencies import Latencies
from traverse.daemon.monitoring.loop_cycles import (
    FILES,
    KEPT,
    CycleLog,
    GarbageCollectionTimer,
    write_report,
)
from traverse.drivers.base.values import DeviceCounters


class Bench:
    def __init__(self) -> None:
        self.clock = SetClock()
        self.pauses, self.handling = Latencies(), Latencies()
        self.collections = GarbageCollectionTimer(self.pauses)
        self.cycles = CycleLog(self.clock, self.collections, self.handling)

    def cycle(self, begun_ns, took_ns=1000, *, device="base", late_ns=0, queue=0):
        """Samples of one device, handled at a moment."""
        samples = count_samples(np.zeros((4, 3)), start_ns=begun_ns)
        late_by_ns = begun_ns + late_ns
        self.clock.now_ns = late_by_ns + took_ns
        samples = replace(samples, received_ns=begun_ns)
        self.cycles.record(device, samples, late_by_ns, queue)


def report_of(bench, reason=""):
    return json.loads("".join(bench.cycles.report(reason).lines()))


@pytest.fixture
def bench():
    return Bench()


def test_a_cycle_tells_how_late_and_long_it_was_and_what_waited(bench):
    bench.cycle(5 * 10**12, 30_000, late_ns=7000, queue=12)
    bench.clock.now_ns = 6 * 10**12
    bench.cycles.record("base", DeviceCounters("base", {}), 6 * 10**12, 0)
    report = report_of(bench, "fault")
    assert report["schema"] == "traverse/cycles/1"
    assert report["reason"] == "fault"
    assert int(report["time_ns"]) == 6 * 10**12 + UTC_OFFSET_NS
    assert report["cycles"] == [
        {
            "device": "base",
            "kind": "CountSamples",
            "begun_ns": 5 * 10**12 + 7000,
            "took_ns": 30_000,
            "samples": 4,
            "late_ns": 7000,
            "queue": 12,
            "collection_ns": 0,
        },
        {
            "device": "base",
            "kind": "DeviceCounters",
            "begun_ns": 6 * 10**12,
            "took_ns": 0,
            "samples": 0,
            "late_ns": None,
            "queue": 0,
            "collection_ns": 0,
        },
    ]
    assert bench.handling.figures().n == 2


def test_jitter_is_what_intervals_depart_from_their_median(bench):
    times_ns = np.cumsum([0, 10, 10, 13, 10, 9, 10]) * 1_000_000
    for time_ns in times_ns:
        bench.cycle(10**12 + int(time_ns))
    bench.cycle(2 * 10**12, device="seldom")
    assert report_of(bench)["devices"] == {
        "base": {
            "interval_us": 10_000.0,
            "jitter_p50_us": 0.0,
            "jitter_max_us": 3000.0,
        }
    }


def test_the_ring_keeps_the_last_thousand(bench):
    for k in range(KEPT + 5):
        bench.cycle(10**12 + k)
    cycles = report_of(bench)["cycles"]
    assert len(cycles) == KEPT
    assert cycles[0]["begun_ns"] == 10**12 + 5


def test_a_collection_is_told_in_the_cycle_that_it_interrupted(bench):
    with bench.collections:
        bench.cycle(10**12)
        gc.collect()
        bench.cycle(2 * 10**12)
        bench.cycle(3 * 10**12)
        told = [c["collection_ns"] for c in report_of(bench)["cycles"]]
        assert told[1] > 0
        assert bench.pauses.figures().n >= 1
        assert bench.pauses.total_ns >= told[1]
    assert bench.collections._time not in gc.callbacks


def test_files_are_named_by_their_time_and_only_the_latest_stay(bench, tmp_path):
    (tmp_path / "outbox.db").touch()
    for k in range(FILES + 3):
        bench.clock.now_ns = 10**12 + k * 1_000_000
        path = write_report(tmp_path, bench.cycles.report(f"number {k}"))
    assert path.name == "cycles-20231114T223000.012Z.json"  # by `date -u -d @...`
    files = sorted(tmp_path.glob("cycles-*"))
    assert len(files) == FILES
    reasons = [json.loads(file.read_text())["reason"] for file in files]
    assert reasons == [f"number {k}" for k in range(3, FILES + 3)]
    assert (tmp_path / "outbox.db").exists()
