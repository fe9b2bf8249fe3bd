"""Elements against published fits, another minimiser, and differences."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from traverse.kinematics.fits.elements import (
    ANGLE,
    DIRECTION,
    PLACE,
    RADIUS,
    line_element,
    plane_element,
    point_element,
    sphere_element,
)
from traverse.kinematics.fits.elements_about_axis import cone_element, cylinder_element
from traverse.kinematics.fits.elements_in_plane import (
    circle_element,
    line_in_plane_element,
)

FLAT = plane_element(np.array([[0.0, 0, 0], [9, 0, 0], [0, 9, 0], [9, 9, 0]]))


def test_a_circle_published_by_gander_golub_and_strebel():
    """Least-squares fitting of circles and ellipses, BIT 34 (1994), section 1."""
    flat = np.array([[1.0, 7], [2, 6], [5, 8], [7, 7], [9, 5], [3, 7]])
    circle, _ = circle_element(np.column_stack([flat, np.zeros(6)]), FLAT)
    assert np.round(circle.place_mm[:2], 4).tolist() == [4.7398, 2.9835]
    assert round(circle.values[RADIUS], 4) == 4.7142


def test_a_cylinder_published_by_openindy():
    """Eight points with radial corrections, as OpenIndy's tests state them (OI-494)."""
    points_mm = np.array(
        [
            [-3283.654, -79.927, 194.917],
            [-3271.578, -84.991, 203.643],
            [-3292.599, -64.647, 196.517],
            [-3308.806, -73.417, 213.805],
            [-3301.555, -87.819, 210.971],
            [-3289.428, -79.973, 198.027],
            [-3292.505, -57.849, 200.595],
            [-3303.342, -63.362, 213.794],
        ]
    )
    cylinder = cylinder_element(points_mm)
    assert cylinder.values[RADIUS] == pytest.approx(19.16, abs=0.005)
    published = [0.026, -0.007, -0.037, 0.010, -0.003, -0.007, 0.030, -0.012]
    np.testing.assert_allclose(cylinder.fit.distances_mm, published, atol=6e-4)


def on_axis(rng, n, radius_mm, half_angle, length_mm=40.0):
    """Points of a cylinder or cone about z, its radius at z = 0."""
    turns = 2 * np.pi * (np.arange(n) + rng.uniform(0, 0.5, n)) / n * 3
    heights = np.linspace(0, length_mm, n)
    radii = radius_mm + heights * np.tan(half_angle)
    return np.column_stack([radii * np.cos(turns), radii * np.sin(turns), heights])


def oriented(points_mm, rng):
    turn = Rotation.random(random_state=rng.integers(2**31))
    return turn.apply(points_mm) + rng.uniform(-900, 900, 3)


def independent(points_mm, start, half_angle):
    """Minimise distances from an axis by four numbers: another parametrisation."""
    place, direction, radius, angle = start

    def distances(q):
        turn = Rotation.from_rotvec([q[2], q[3], 0.0])
        axis = frame.apply(turn.apply([0.0, 0.0, 1.0]))
        centre = place + frame.apply([q[0], q[1], 0.0])
        along = (points_mm - centre) @ axis
        rho = np.linalg.norm(np.cross(points_mm - centre, axis), axis=1)
        psi = q[5] if half_angle else 0.0
        return (rho - q[4]) * np.cos(psi) - along * np.sin(psi)

    frame, _ = Rotation.align_vectors([direction], [[0.0, 0.0, 1.0]])
    first = [0, 0, 0, 0, radius, angle][: 6 if half_angle else 5]
    return least_squares(distances, first, xtol=1e-15, ftol=1e-15, gtol=1e-15)


@pytest.mark.parametrize("half_angle", [0.0, 0.1, 0.5, 1.0])
@pytest.mark.parametrize("seed", range(4))
def test_cylinders_and_cones_have_the_minimum_that_scipy_finds(half_angle, seed):
    rng = np.random.default_rng([seed, int(100 * half_angle)])
    points_mm = oriented(on_axis(rng, 15, 12.0, half_angle), rng)
    points_mm += 0.05 * rng.normal(size=points_mm.shape)
    fit = cone_element if half_angle else cylinder_element
    element = fit(points_mm)
    values = element.values
    start = element.place_mm, element.direction, values[RADIUS], values[ANGLE]
    other = independent(points_mm, start, half_angle)
    squares = float(element.fit.distances_mm @ element.fit.distances_mm)
    assert squares == pytest.approx(2.0 * other.cost, rel=1e-9)
    assert values[RADIUS] == pytest.approx(other.x[4], abs=1e-6)
    assert np.abs(other.x[:4]).max() < 1e-6
    if half_angle:
        assert values[ANGLE] == pytest.approx(half_angle, abs=0.02)


def fitted(kind, points_mm, plane_points_mm, offset_mm=0.0):
    """The element, and its derivatives by its points and by its plane's."""
    plane = plane_element(plane_points_mm)
    if kind in ("circle", "edge"):
        if kind == "circle":
            element, by_plane = circle_element(points_mm, plane, offset_mm)
        else:
            element, by_plane = line_in_plane_element(
                points_mm, plane, offset_mm, np.array([0.3, 1.0, 0.2])
            )
        return element, np.einsum("qp,pni->qni", by_plane, plane.by_points)
    fits = {
        "point": lambda: point_element(points_mm),
        "line": lambda: line_element(points_mm),
        "plane": lambda: plane_element(points_mm, offset_mm, np.array([0.1, 0.1, 1])),
        "sphere": lambda: sphere_element(points_mm, offset_mm),
        "cylinder": lambda: cylinder_element(points_mm, offset_mm),
        "cone": lambda: cone_element(points_mm, offset_mm),
    }
    return fits[kind](), None


def exact_points(kind, rng):
    n = 12
    along = np.linspace(-30, 30, n)
    turns = 2 * np.pi * np.arange(n) / n
    ring = np.column_stack([np.cos(turns), np.sin(turns), np.zeros(n)])
    sphere = rng.normal(size=(n, 3))
    return {
        "point": np.zeros((3, 3)),
        "line": np.outer(along, [0.2, 0.3, 1.0]),
        "edge": np.outer(along, [1.0, 0.1, 0.0]) + np.array([0, 0, 3.0]),
        "plane": np.column_stack([rng.uniform(-40, 40, (n, 2)), np.zeros(n)]),
        "circle": 14.0 * ring + [5.0, -3.0, 6.0],
        "sphere": 20.0 * sphere / np.linalg.norm(sphere, axis=1, keepdims=True),
        "cylinder": on_axis(rng, n, 12.0, 0.0),
        "cone": on_axis(rng, n, 12.0, 0.4),
    }[kind]


KINDS = ["point", "line", "edge", "plane", "circle", "sphere", "cylinder", "cone"]


@pytest.mark.parametrize("kind", KINDS)
def test_derivatives_by_points_are_differences(kind):
    """Of points on the element, where first order is exact; the plane is tilted."""
    rng = np.random.default_rng(8)
    points_mm = exact_points(kind, rng)
    plane_mm = np.column_stack([rng.uniform(-60, 60, (5, 2)), np.zeros(5)])
    element, by_plane_points = fitted(kind, points_mm, plane_mm, 2.0)
    step_mm = 1e-4
    for row in range(0, len(points_mm), 4):
        for axis in range(3):
            moved_mm = points_mm.copy()
            moved_mm[row, axis] += step_mm
            up, _ = fitted(kind, moved_mm, plane_mm, 2.0)
            moved_mm[row, axis] -= 2 * step_mm
            down, _ = fitted(kind, moved_mm, plane_mm, 2.0)
            slope = across_axis(kind, element, (up.values - down.values) / 2 / step_mm)
            expected = across_axis(kind, element, element.by_points[:, row, axis])
            np.testing.assert_allclose(expected, slope, atol=2e-5)
    if by_plane_points is None:
        return
    for row in range(len(plane_mm)):
        moved_mm = plane_mm.copy()
        moved_mm[row, 2] += step_mm
        up, _ = fitted(kind, points_mm, moved_mm, 2.0)
        moved_mm[row, 2] -= 2 * step_mm
        down, _ = fitted(kind, points_mm, moved_mm, 2.0)
        slope = across_axis(kind, element, (up.values - down.values) / 2 / step_mm)
        expected = across_axis(kind, element, by_plane_points[:, row, 2])
        np.testing.assert_allclose(expected, slope, atol=2e-5)


def across_axis(kind, element, change):
    """A change without the motion of the place along the element; of cones along it."""
    change = change.copy()
    axis = element.direction
    if kind in ("line", "edge", "cylinder", "cone"):
        along = change[PLACE] @ axis
        change[PLACE] -= along * axis
        if kind == "cone":
            change[RADIUS] -= along * np.tan(element.values[ANGLE])
    if kind == "plane":
        change[PLACE] = axis * (change[PLACE] @ axis)
    return change


@given(seed=st.integers(0, 10_000), kind=st.sampled_from(["cylinder", "cone", "line"]))
@settings(max_examples=15, deadline=None)
def test_elements_move_with_their_points(seed, kind):
    rng = np.random.default_rng(seed)
    points_mm = exact_points(kind, rng) + 0.02 * rng.normal(size=(12, 3))
    turn, shift_mm = Rotation.random(random_state=seed), rng.uniform(-500, 500, 3)
    before, _ = fitted(kind, points_mm, np.eye(3))
    after, _ = fitted(kind, turn.apply(points_mm) + shift_mm, np.eye(3))
    assert after.values[RADIUS] == pytest.approx(before.values[RADIUS], abs=1e-7)
    assert after.values[ANGLE] == pytest.approx(before.values[ANGLE], abs=1e-9)
    moved_mm = turn.apply(before.place_mm) + shift_mm
    np.testing.assert_allclose(after.place_mm, moved_mm, atol=1e-6)
    along = abs(float(turn.apply(before.direction) @ after.direction))
    assert along == pytest.approx(1.0, abs=1e-12)


def test_the_ball_is_compensated_across_the_surface():
    rng = np.random.default_rng(2)
    cylinder = cylinder_element(on_axis(rng, 12, 12.0, 0.0), 3.0)
    assert cylinder.values[RADIUS] == pytest.approx(15.0)
    cone = cone_element(on_axis(rng, 12, 12.0, 0.5), -3.0)
    at_start = cone.values[RADIUS] - np.tan(0.5) * cone.place_mm[2]
    assert at_start == pytest.approx(12.0 - 3.0 / np.cos(0.5))
    assert cone.values[DIRECTION][2] == pytest.approx(1.0)
    flat = plane_element(exact_points("plane", rng), 3.0, np.array([0.0, 0.2, -1.0]))
    np.testing.assert_allclose(flat.direction, [0, 0, -1], atol=1e-12)
    assert flat.place_mm[2] == pytest.approx(3.0)


CYLINDER_MM = on_axis(np.random.default_rng(1), 12, 9.0, 0.0)


@pytest.mark.parametrize(
    ("fit", "points_mm", "message"),
    [
        (cylinder_element, np.eye(3), "expected at least 6"),
        (cylinder_element, np.arange(30.0).reshape(10, 3), "one plane"),
        (cone_element, CYLINDER_MM, "cylinder"),
        (lambda p: cylinder_element(p, -20.0), CYLINDER_MM, "larger than"),
        (
            lambda p: plane_element(p, 1.0, np.array([1.0, 0, 0])),
            np.array([[0.0, 0, 5], [1, 0, 5], [0, 1, 5]]),
            "side of the material",
        ),
        (line_element, np.eye(3), "no line"),
    ],
)
def test_what_fits_nothing_is_refused(fit, points_mm, message):
    with pytest.raises(ValueError, match=message):
        fit(points_mm)
