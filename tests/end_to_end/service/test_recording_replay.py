"""Recordings of the real daemon, replayed by the real command."""

import json
import os
import signal
from pathlib import Path
from typing import Any

import pytest

from tests.end_to_end.measurement.test_capture_points import LIBRARY, result
from tests.end_to_end.measuring import measuring
from tests.end_to_end.programs import Program
from tests.end_to_end.workbench import SPHERE, Workbench
from traverse.protocol.messages import (
    Label,
    LabelArgs,
    Point,
    PointArgs,
    ProbeArgs,
    RecordArgs,
    ReloadArgs,
    ScanArgs,
    UndoArgs,
)
from traverse.testing.waiting import until

pytestmark = pytest.mark.needs("mosquitto")


async def replayed(
    bench: Workbench, path: Path, *options: str
) -> tuple[dict[str, Any], list[Point]]:
    """Output of `traverse replay`, and the points that it writes."""
    written = ("--out", "points.jsonl", "--force")
    arguments = ("replay", str(path), "--json", *written, *options)
    with Program(bench.folder, "replay", *arguments) as program:
        status = await program.ended()
        assert status == 0, program.output + program.log
        report = json.loads(program.output)
    lines = (bench.folder / "points.jsonl").read_text("utf-8").splitlines()
    return report, [Point.model_validate_json(line) for line in lines]


def size_of(path: Path) -> int:
    return path.stat().st_size


def assert_the_same(published: list[Point], points: list[Point]) -> None:
    """A subscriber's messages and a replay's output: equal in all but the numbers."""
    published_at = {p.time_ns: p for p in published if p.retracts is None}
    now = [p for p in points if p.retracts is None]
    assert len(now) >= 14
    for point in now:
        original = published_at[point.time_ns]
        assert (point.xyz_mm, point.ijk, point.angles_rad) == (
            original.xyz_mm,
            original.ijk,
            original.angles_rad,
        )
        assert point.covariance_mm2 == original.covariance_mm2
        assert point.surface_mm == original.surface_mm
        assert point.quality == original.quality
        assert point.label == original.label
        assert point.model == original.model
    assert {p.label for p in now} == {Label(), Label(artefact="ball")}
    assert len({p.model for p in now}) == 2


@pytest.mark.slow
async def test_a_replay_gives_what_was_published_to_the_last_bit(
    bench: Workbench,
) -> None:
    bench.write_simulator(SPHERE.format(points=200), arm="noise_rad = 5e-6")
    bench.write_daemon(capture='compensation = "pretouch"\npretouch_mm = 1.0')
    (bench.folder / "probes.toml").write_text(LIBRARY, "utf-8")
    with_probes = 'file = "arm.toml"\nprobes = "probes.toml"'
    bench.change("daemon.toml", 'file = "arm.toml"', with_probes)
    async with measuring(bench) as (listener, _, _):
        await listener.n_points(2)
        start = RecordArgs(action="start", name="first", note="all sorts of things")
        path = Path(str(result(await listener.command(start))["file"]))
        repeated = await listener.command(RecordArgs(action="start", name="second"))
        await listener.n_points(5)
        result(await listener.command(PointArgs()))
        result(await listener.command(LabelArgs(artefact="ball")))
        scan = await listener.start_scan(500.0)
        await listener.n_points(8)
        await listener.scan_points(scan, 150)
        result(await listener.command(ScanArgs(action="stop")))
        result(await listener.command(UndoArgs()))
        result(await listener.command(ProbeArgs(name="long")))
        await listener.n_points(12)
        bench.change("daemon.toml", "pretouch_mm = 1.0", "pretouch_mm = 1.5")
        result(await listener.command(ReloadArgs()))
        await listener.n_points(16)
        recorded = result(await listener.command(RecordArgs(action="stop")))
        stopped = await listener.command(RecordArgs(action="stop"))
        health = listener.healths[-1].recording
    assert not repeated.ok
    assert repeated.error is not None
    assert repeated.error.code == "recording.busy"
    assert stopped.error is not None
    assert stopped.error.code == "recording.none"
    assert health.state in ("recording", "flight")
    assert (recorded["gaps"], size_of(path)) == (0, recorded["bytes"])
    report, points = await replayed(bench, path)
    assert report["holds"]
    assert report["points"]["compared"] == report["points"]["same"] >= 16
    assert report["scan_points"]["compared"] == report["scan_points"]["same"] > 100
    assert report["tear"] is None
    assert_the_same(listener.points, points)
    for block in ("1", "777"):
        report, _ = await replayed(bench, path, "--block", block)
        assert report["holds"]


async def test_what_a_killed_daemon_recorded_is_kept_and_can_be_replayed(
    bench: Workbench,
) -> None:
    bench.write_simulator(SPHERE.format(points=200))
    bench.write_daemon()
    async with measuring(bench) as (listener, _, daemon):
        await listener.n_points(8)
        # The flight recorder flushes every second.
        flight = bench.folder / "state" / "recordings" / "flight"
        await until(
            lambda: any(f.stat().st_size > 20_000 for f in flight.iterdir()), ""
        )
        os.kill(daemon.process.pid, signal.SIGKILL)
        daemon.process.wait()
        with bench.daemon(name="second") as second:
            event = await listener.event("recording.kept")
            assert await second.stop() == 0
    path = Path(event.text.rpartition(" ")[2])
    assert path.name.endswith("-crash.mcap")
    report, _ = await replayed(bench, path)
    assert report["holds"]
    assert report["points"]["same"] >= 1
