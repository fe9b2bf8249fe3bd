"""How points and scans must agree with the simulator's truth."""

from typing import Any

import numpy as np
import pytest

from tests.end_to_end.arm_matrices import MatrixArm
from tests.end_to_end.workbench import Workbench
from traverse.protocol.messages import Point


def assert_one_point_an_edge(
    bench: Workbench, points: list[Point], truth: list[dict[str, Any]]
) -> None:
    """Numbered from 0, each with the counts and the time of its edge.

    On a busy machine the board's clock may be in doubt at some, at most at half.
    """
    assert [p.seq for p in points] == list(range(len(truth)))
    assert len({p.id for p in points}) == len(points)
    assert {(p.arm, len(p.session)) for p in points} == {(bench.arm, 32)}
    arm = MatrixArm(bench.arm_file)
    turns = np.array([2**23] * 4 + [2**22] * 3)
    for point, edge in zip(points, truth, strict=True):
        counts = np.array(edge["counts"])
        assert ((np.array(point.counts) - counts) % turns == 0).all()
        xyz_mm, shank = arm.pose(counts)
        assert np.abs(np.array(point.xyz_mm) - xyz_mm).max() < 1e-9
        assert np.abs(np.array(point.ijk) - shank).max() < 1e-12
        assert point.angles_rad == pytest.approx(arm.angles_rad(point.counts), 1e-14)
        doubts = {"time_uncertain", "motion_unknown"}
        assert set(point.quality.flags) <= doubts, point.quality.flags
    certain = [not is_marked_for_time(point) for point in points]
    assert 2 * sum(certain) >= len(points)
    # The mapping of the board's clock is still settling, and a busy machine reads
    # late; `test_points` is stricter where nothing disturbs.
    delays = delays_s(points, truth)[certain]
    assert np.ptp(delays) < 0.1, delays - delays[-1]


def assert_where_the_ball_was(
    bench: Workbench,
    points: list[Point],
    truth: list[dict[str, Any]],
    roundings: float = 1.0,
    *,
    by_several_clocks: bool = False,
) -> None:
    """The hand rests while it presses; what is left is the rounding of counts.

    On a busy machine a clock may be in doubt: of points that are marked so this need
    not hold, and at most half may be. Several clocks are not known as well there: then
    a point may be off by what its covariance states, and one that is not marked is
    enough.
    """
    most_mm = roundings * MatrixArm(bench.arm_file).resolution_mm()
    n_marked = 0
    for point, edge in zip(points, truth, strict=True):
        off_mm = np.abs(np.array(point.xyz_mm) - edge["centre_mm"]).max()
        if is_marked_for_time(point):
            assert not point.quality.ok
            n_marked += 1
        elif by_several_clocks and point.covariance_mm2 is not None:
            stated_mm = 4.0 * np.sqrt(np.trace(covariance(point)))
            assert off_mm < max(most_mm, stated_mm), (point, edge, truth)
        else:
            assert off_mm < most_mm, (point, edge, truth)
    n_certain = len(points) - n_marked
    assert n_certain >= (1 if by_several_clocks else n_marked), points


def is_marked_for_time(point: Point) -> bool:
    """Whether a point says that its instant is in doubt."""
    return bool({"skew", "time_uncertain"}.intersection(point.quality.flags))


def delays_s(points: list[Point], truth: list[dict[str, Any]]) -> np.ndarray:
    """Times of points against the truth, up to a constant."""
    taken_s = np.array([p.time_ns - points[0].time_ns for p in points]) * 1e-9
    return taken_s - np.array([edge["time_s"] for edge in truth])


def covariance(point: Point) -> np.ndarray:
    """Of a point [mm2], (3, 3)."""
    assert point.covariance_mm2 is not None
    xx, xy, xz, yy, yz, zz = point.covariance_mm2
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
