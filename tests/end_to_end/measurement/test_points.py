"""Points against the simulator's truth: each edge once, in order, where it was."""

from typing import Any

import numpy as np
import pytest

from tests.end_to_end.agreement import (
    assert_one_point_an_edge,
    assert_where_the_ball_was,
    delays_s,
)
from tests.end_to_end.arm_matrices import MatrixArm
from tests.end_to_end.measuring import measuring
from tests.end_to_end.workbench import CONE, SPHERE, Workbench, rest
from traverse.protocol.messages import Point

pytestmark = pytest.mark.needs("mosquitto")


async def measured(
    bench: Workbench, n: int, trigger: str = "button", capture: str = ""
) -> tuple[list[Point], list[dict[str, Any]]]:
    """Points of a whole script with n presses, and the truth at these."""
    bench.write_daemon(trigger=trigger, capture=capture)
    async with measuring(bench) as (listener, _, _):
        await listener.n_points(n)
    truth = [e for e in bench.presses() if e["input_name"] == trigger]
    return listener.points, truth


async def test_every_press_is_one_point_where_the_ball_truly_was(
    bench: Workbench,
) -> None:
    bench.write_simulator(rest(1.0), SPHERE.format(points=8), CONE.format(postures=4))
    points, truth = await measured(bench, 12, capture="tracking_rate_hz = 1000.0")
    assert_one_point_an_edge(bench, points, truth)
    assert {p.trigger for p in points} == {"button"}
    delays = delays_s(points, truth)
    assert np.median(np.abs(delays - np.median(delays))) < 5e-4
    assert np.ptp(delays) < 2e-3
    assert {p.probe_radius_mm for p in points} == {3.0}
    # Truth and arm file are the same arm here: only counts are rounded.
    assert_where_the_ball_was(bench, points, truth)
    for point, edge in zip(points, truth, strict=True):
        assert np.abs(np.array(point.ijk) - edge["shank"]).max() < 1e-5
    rounding_mm = MatrixArm(bench.arm_file).resolution_mm()
    on_ball = np.array([p.xyz_mm for p in points[:8]]) - [700.0, 100.0, 120.0]
    assert np.linalg.norm(on_ball, axis=1) == pytest.approx(53.8, abs=2 * rounding_mm)


@pytest.mark.slow
async def test_points_keep_to_the_arm_file_where_the_true_arm_differs(
    bench: Workbench,
) -> None:
    bench.write_simulator(
        SPHERE.format(points=6),
        arm="noise_rad = 2e-6\n[arm.deviations]\nlinks_mm = 0.1\naxes_rad = 1e-4",
        board="first_ticks = 4294467296\nclock_error_ppm = 80.0\n",  # wraps soon
    )
    points, truth = await measured(bench, 6)
    assert_one_point_an_edge(bench, points, truth)
    off_mm = [
        np.linalg.norm(np.array(p.xyz_mm) - e["centre_mm"])
        for p, e in zip(points, truth, strict=True)
    ]
    assert 1e-3 < max(off_mm) < 1.0
