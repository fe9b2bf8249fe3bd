"""The recorder: segments, faults, crashes, full disks, floods; measuring continues."""

import asyncio
import contextlib
import resource
import signal
from pathlib import Path

import numpy as np
import pytest

from tests.daemon.recorder.recorded_runs import RecordedRun, replayed
from traverse.daemon.errors import RequestRefusedError
from traverse.drivers.base.values import CountSamples
from traverse.protocol.messages import Event, RecordArgs
from traverse.recording.run_reader import RunReader
from traverse.testing.waiting import until


def fault(run, code="alarm.encoder_error", severity="error"):
    now_ns = run.clock.now_ns
    event = Event(
        arm="bench-7",
        session="s",
        severity=severity,
        code=code,
        text="an encoder fails",
        remedy="",
        source="base",
        active=True,
        first_ns=now_ns,
        last_ns=now_ns,
        count=1,
        data={},
    )
    run.steps.published(now_ns, event)


def events_of(run, code):
    return [event for event in run.events if event.code == code]


def kept(run):
    return sorted((run.folder / "recordings").glob("flight-*.mcap"))


async def test_the_last_seconds_before_a_fault_are_kept_and_can_be_replayed(tmp_path):
    async with RecordedRun(tmp_path) as run:
        for _ in range(10):
            run.later(1.5)
            run.click()
        fault(run, severity="warning")
        fault(run, code="broker.lost")
        run.later(3.0)
        fault(run)
        run.later(1.0)
        fault(run)
        run.later(1.5)
        await until(lambda: events_of(run, "recording.kept"))
    (path,) = kept(run)
    assert path.name.endswith("Z-alarm.encoder_error.mcap")
    assert str(path) in events_of(run, "recording.kept")[0].text
    with RunReader(path) as reader:
        topics = {entry.topic for entry in reader}
        assert reader.about["cause"] == "alarm.encoder_error"
        assert reader.tear is None
    assert {"log", "point", "steps", "device/base/samples"} <= topics
    result, _ = await asyncio.to_thread(replayed, path)
    assert result.holds
    assert result.points.sure.same == 10
    assert result.samples == pytest.approx(2050, abs=60)  # of 100 Hz: 2 s after it


async def test_segments_are_bounded_by_time(tmp_path):
    async with RecordedRun(tmp_path, flight_s=20.0, flush_s=0.1) as run:
        flight = tmp_path / "recordings" / "flight"
        for _ in range(9):
            run.later(11.0, every_s=0.5)
            await asyncio.sleep(0.3)
        segments = sorted(flight.iterdir())
    assert 2 <= len(segments) <= 4
    last = run.clock.now_ns + run.clock.offset_ns
    oldest = int(segments[0].stem.removeprefix("segment-"))
    assert 20.0 <= (last - oldest) * 1e-9 <= 45.0


def n_entries_torn(segment: Path, torn: Path, n_bytes: int = 100) -> int:
    content = segment.read_bytes()
    torn.write_bytes(content[: len(content) - n_bytes])
    with contextlib.suppress(ValueError), RunReader(torn) as reader:
        return len(list(reader))
    return 0


async def test_what_a_dead_daemon_left_is_kept_and_what_an_orderly_one_left_is_not(
    tmp_path,
):
    async with RecordedRun(tmp_path, flush_s=0.1) as run:
        run.later(2.0)
        run.click()
        flight = tmp_path / "recordings" / "flight"
        await until(lambda: any(flight.glob("*")))
        (segment,) = flight.iterdir()
        torn = tmp_path / "torn.mcap"
        await until(lambda: n_entries_torn(segment, torn, 0) > 10)
        run.later(1.0)
        await until(lambda: n_entries_torn(segment, torn) > 10)
    n_bytes = segment.stat().st_size
    async with RecordedRun(tmp_path) as run:  # whose first one has the same name
        await until(
            lambda: not any(old.stat().st_size >= n_bytes for old in flight.iterdir())
        )
    assert kept(run) == []
    for old in flight.iterdir():
        old.unlink()
    torn.rename(segment)
    async with RecordedRun(tmp_path) as run:
        await until(lambda: events_of(run, "recording.kept"))
    (path,) = kept(run)
    assert path.name.endswith("-crash.mcap")
    with RunReader(path) as reader:
        assert len(list(reader)) > 10


async def test_the_oldest_kept_file_goes(tmp_path):
    async with RecordedRun(tmp_path, kept=2) as run:
        run.later(0.5)
        for n in range(3):
            fault(run, f"alarm.a{n}")
            run.later(33.0, every_s=0.5)
            await until(lambda n=n: len(events_of(run, "recording.kept")) == n + 1)
        health = run.recorder.health()
    assert [path.name.rpartition("-")[2] for path in kept(run)] == [
        "alarm.a1.mcap",
        "alarm.a2.mcap",
    ]
    assert (health.kept, health.kept_dropped) == (3, 1)


async def test_without_a_flight_recorder_only_what_is_requested_is_written(tmp_path):
    async with RecordedRun(tmp_path, flight=False) as run:
        run.later(3.0)
        assert run.recorder.health().state == "off"
        path = await run.recorder.begin("asked", "by hand")
        assert run.recorder.health().state == "recording"
        run.later(8.0)
        run.click()
        run.later(0.5)
        recorded = await run.recorder.finish()
        run.later(3.0)
    assert recorded.path == path
    assert list((tmp_path / "recordings").iterdir()) == [path]
    result, points = await asyncio.to_thread(replayed, path)
    assert result.holds
    assert result.points.sure.same == len(points) == 1


async def test_a_recording_without_room_is_refused_and_measuring_continues(tmp_path):
    async with RecordedRun(tmp_path, min_free_mb=1_000_000) as run:
        run.later(1.0)
        await until(lambda: events_of(run, "recording.failed"))
        run.click()
        with pytest.raises(
            RequestRefusedError, match=r"only [0-9]+ MB are free"
        ) as refusal:
            await run.recorder.carry_out(RecordArgs(action="start", name="asked"))
        assert run.recorder.health().state == "failed"
        run.later(0.5)
    assert refusal.value.code == "recording.failed"
    (event,) = events_of(run, "recording.failed")
    assert (event.severity, event.active) == ("error", True)
    assert "min_free_mb" in event.text
    assert len(run.points) == 1


async def test_a_disk_that_fails_stops_the_recording_alone(tmp_path):
    ignored = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    try:
        async with RecordedRun(tmp_path, flight=False, flush_s=0.1) as run:
            path = await run.recorder.begin("asked", "")
            resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, limits[1]))
            run.later(20.0)
            await until(lambda: events_of(run, "recording.stopped"))
            resource.setrlimit(resource.RLIMIT_FSIZE, limits)
            run.click()
            run.later(0.1)
            with pytest.raises(RequestRefusedError, match="nothing is being recorded"):
                await run.recorder.carry_out(RecordArgs(action="stop"))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        signal.signal(signal.SIGXFSZ, ignored)
    (event,) = events_of(run, "recording.stopped")
    assert event.severity == "error"
    assert "File too large" in event.text
    assert len(run.points) == 1
    with RunReader(path) as reader:
        list(reader)
        assert reader.tear is not None


async def test_names_are_used_once_and_one_recording_runs_at_a_time(tmp_path):
    async with RecordedRun(tmp_path) as run:
        start = RecordArgs(action="start", name="one", note="n")
        assert (await run.recorder.carry_out(start))["name"] == "one"
        with pytest.raises(RequestRefusedError, match="'one' is being recorded"):
            await run.recorder.carry_out(RecordArgs(action="start", name="two"))
        run.later(0.2)
        result = await run.recorder.carry_out(RecordArgs(action="stop"))
        assert result["gaps"] == 0
        with pytest.raises(RequestRefusedError, match="is there already"):
            await run.recorder.carry_out(start)
    assert [e.code for e in run.events] == ["recording.started", "recording.stopped"]


async def test_a_flood_leaves_a_gap_that_is_reported_and_a_replay_continues_after_it(
    tmp_path,
):
    async with RecordedRun(tmp_path) as run:
        path = await run.recorder.begin("asked", "")
        run.later(1.0)
        run.click()
        # No `await` meanwhile, and more than the queue's bytes.
        n = 700_000
        flood = CountSamples(
            "other",
            1,
            np.arange(n),
            np.arange(n),
            0,
            np.arange(n),
            np.zeros(n, np.uint8),
            np.zeros((n, 8), np.uint32),
            np.zeros((n, 8), np.uint8),
        )
        run.steps.delivered(run.clock.now_ns, flood, run.measurement)
        await until(lambda: run.recorder.health().queued == 0)
        run.later(8.0)
        run.click()
        run.later(1.0)
        recorded = await run.recorder.finish()
        dropped = run.recorder.health().dropped
    assert dropped >= 1
    assert recorded.gaps == 1
    assert events_of(run, "recording.overflow")
    result, _ = await asyncio.to_thread(replayed, path)
    assert result.gaps == 1
    assert result.points.sure.same == result.points.sure.n == 2
    assert result.holds
