import signal

import numpy as np
import pytest

from tests.end_to_end.arm_matrices import MatrixArm
from tests.end_to_end.listener import Listener, numbers, times_ns
from tests.end_to_end.measuring import measuring
from tests.end_to_end.workbench import DEMO_ARM, REST, SPHERE, SWEEP, Workbench
from traverse.kinematics.arm_file.arm import read_arm
from traverse.protocol.messages import (
    AlignArgs,
    PointArgs,
    QualityFlag,
    ReloadArgs,
    Scan,
)

BALL_MM = read_arm(DEMO_ARM).probe.radius_mm
pytestmark = pytest.mark.needs("mosquitto")


async def scanned(listener: Listener, n: int, **args: object) -> list[Scan]:
    scan = await listener.start_scan(**args)
    await listener.scan_points(scan, n)
    blocks = await listener.stop_scan(scan)
    assert (numbers(blocks) == np.arange(blocks[-1].total or 0)).all()
    assert (blocks[-1].lost, blocks[-1].dropped) == (0, 0)
    return blocks


def places_mm(blocks: list[Scan]) -> np.ndarray:
    return np.concatenate([block.xyz_mm for block in blocks])


def in_contact(xyz_mm: np.ndarray) -> np.ndarray:
    """Which places (n, 3) of the ball's centre touch the swept sphere, (n,)."""
    away_mm = np.linalg.norm(xyz_mm - [700.0, 100.0, 120.0], axis=1)
    return np.asarray(np.abs(away_mm - 50.8 - BALL_MM) < 0.05)


async def test_a_scan_by_distance_has_its_points_so_far_apart(bench: Workbench) -> None:
    bench.write_simulator(SWEEP, top="repeat = true")
    bench.write_daemon()
    async with measuring(bench) as (listener, _, _):
        blocks = await scanned(listener, 200, mode="distance", spacing_mm=2.0)
    found_mm = places_mm(blocks)
    steps_mm = np.linalg.norm(np.diff(found_mm, axis=0), axis=1)
    assert (steps_mm >= 2.0).all()
    # While it sweeps at 200 mm/s on average, no point is more than a sample too far.
    sweeps = np.flatnonzero(in_contact(found_mm[1:]) & in_contact(found_mm[:-1]))
    assert len(sweeps) > 20
    assert (steps_mm[sweeps] < 2.0 + 1.0).all()
    assert {(b.mode, b.rate_hz) for b in blocks} == {("distance", None)}
    arm = MatrixArm(bench.arm_file)
    for block in blocks:
        assert block.counts is not None
        for counts, xyz_mm in zip(block.counts, block.xyz_mm, strict=True):
            assert xyz_mm == pytest.approx(arm.pose(counts.tolist())[0], abs=1e-9)


@pytest.mark.slow
async def test_a_scan_at_planes_has_its_points_on_them(bench: Workbench) -> None:
    bench.write_simulator(SWEEP, top="repeat = true")
    bench.write_daemon()
    args = {"mode": "planes", "spacing_mm": 5.0, "offset_mm": 2.5}
    async with measuring(bench) as (listener, _, _):
        blocks = await scanned(listener, 180, normal=(1.0, 0.0, 0.0), **args)
    heights = (places_mm(blocks)[:, 0] - 2.5) / 5.0
    assert heights == pytest.approx(np.rint(heights), abs=1e-9)
    assert len(set(np.rint(heights).tolist())) > 5
    quality = np.concatenate([block.quality for block in blocks])
    assert (quality & QualityFlag.INTERPOLATED).all()
    # Interpolated places lie on the swept sphere, too.
    assert in_contact(places_mm(blocks)).sum() > 20


async def test_a_held_scan_has_all_from_each_press_to_its_release(
    bench: Workbench,
) -> None:
    rate_hz = 1000.0
    bench.write_simulator(SPHERE.format(points=9))
    bench.write_daemon()
    async with measuring(bench) as (listener, _, _):
        # A board that has just connected reports its first edges later than all others.
        await listener.n_points(3)
        scan = await listener.start_scan(rate_hz, held=True)
        await listener.n_points(9)
        await listener.scan_points(scan, 4 * 25)
        blocks = await listener.stop_scan(scan)
    assert listener.events_of("scan.edge_late") == []
    assert (numbers(blocks) == np.arange(blocks[-1].total or 0)).all()
    at_ns = times_ns(blocks)
    stretches = np.split(at_ns, np.flatnonzero(np.diff(at_ns) > 5e6) + 1)
    presses_ns = [point.time_ns for point in listener.points]
    edges = [e for e in bench.truth() if e["event"] == "edge"]
    held_s = [
        (release["ticks"] - press["ticks"]) * 1e-6
        for press, release in zip(edges[::2], edges[1::2], strict=True)
    ]
    n_complete = 0
    for stretch in stretches[:-1]:  # the last may have been cut by the stop
        touch = int(np.searchsorted(presses_ns, stretch[0], side="right")) - 1
        if stretch[0] - presses_ns[touch] > 2e9 / rate_hz:
            continue  # it was held when the scan began
        n_complete += 1
        # Not a sample too few or too many at either end, by the device's own time.
        assert stretch[0] - presses_ns[touch] <= 1.05e9 / rate_hz
        assert len(stretch) == pytest.approx(held_s[touch] * rate_hz, abs=1.0)
    assert n_complete >= 3


@pytest.mark.slow
async def test_filters_of_the_configuration_hold_points_back(bench: Workbench) -> None:
    bench.write_simulator(SWEEP, top="repeat = true")
    bench.write_daemon(
        scan='filters = [{ kind = "box", low_mm = [600, 0, 0], '
        'high_mm = [700, 300, 300] }, { kind = "spacing", spacing_mm = 3.0 }]'
    )
    async with measuring(bench) as (listener, _, _):
        blocks = await scanned(listener, 40, rate_hz=1000.0)
        held_back = listener.healths[-1].counters
    found_mm = places_mm(blocks)
    assert (found_mm[:, 0] <= 700.0).all()
    apart_mm = np.linalg.norm(found_mm[:, np.newaxis] - found_mm, axis=2)
    assert (apart_mm[~np.eye(len(found_mm), dtype=bool)] >= 3.0).all()
    assert held_back["scan_filter_1_box"] > 0
    assert held_back["scan_filter_2_spacing"] > 0


async def test_an_alignment_gives_part_coordinates_and_outlives_a_reload(
    bench: Workbench,
) -> None:
    bench.write_simulator(REST)
    bench.write_daemon()
    align = AlignArgs(
        action="set",
        name="jig",
        rotation=((0.0, -1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
        translation_mm=(10.0, 20.0, 30.0),
    )
    text = bench.arm_file.read_text("utf-8")
    async with measuring(bench) as (listener, _, daemon):
        assert (await listener.command(align)).ok
        await listener.command(PointArgs())
        bench.arm_file.write_text("name = 1", "utf-8")
        refused = await listener.command(ReloadArgs())
        await listener.command(PointArgs())
        bench.arm_file.write_text(
            text.replace("radius_mm = 3.0", "radius_mm = 2.5"), "utf-8"
        )
        daemon.process.send_signal(signal.SIGHUP)
        await listener.event("reload.done")
        await listener.command(PointArgs())
        await listener.n_points(3)
    assert refused.error is not None
    assert refused.error.code == "reload.refused"
    assert "arm.toml" in refused.error.text
    first, second, third = listener.points
    assert first.model == second.model != third.model
    assert [p.probe_radius_mm for p in listener.points] == [3.0, 3.0, 2.5]
    assert [p.seq for p in listener.points] == [0, 1, 2]
    for point in listener.points:
        x, y, z = point.xyz_mm
        assert point.part_xyz_mm == pytest.approx((10.0 - y, 20.0 + x, 30.0 + z))
    assert listener.statuses[-2].model == third.model
    assert (listener.statuses[0].alignment, listener.statuses[-2].alignment) == (
        None,
        "jig",
    )
