"""Shapes by least squares: against 80 digits, turned, refused."""

import numpy as np
import pytest

from tests.kinematics.fits import exact_fits
from traverse.kinematics.fits import fit_plane, fit_sphere


def turned(seed, points):
    """Points turned and moved at random, with the rotation."""
    rng = np.random.default_rng(seed)
    rotation, _ = np.linalg.qr(rng.standard_normal((3, 3)))
    return points @ rotation.T + rng.uniform(-500, 500, 3), rotation


def tube(seed, n_points, radius_mm, length_mm, *arc):
    """Points on a part of a cylinder along z; arc: its angle, and noise."""
    arc_rad, noise_mm = arc
    rng = np.random.default_rng(seed)
    angle = rng.uniform(0, arc_rad, n_points)
    radii = radius_mm + rng.normal(0, noise_mm, n_points)
    height = rng.uniform(-0.5, 0.5, n_points) * length_mm
    return np.column_stack([radii * np.cos(angle), radii * np.sin(angle), height])


def tilted(points):
    """Turned by a little, so that nothing is along an axis of the coordinate frame."""
    x = np.array(
        [[1, 0, 0], [0, np.cos(0.3), -np.sin(0.3)], [0, np.sin(0.3), np.cos(0.3)]]
    )
    y = np.array(
        [[np.cos(0.2), 0, np.sin(0.2)], [0, 1, 0], [-np.sin(0.2), 0, np.cos(0.2)]]
    )
    return points @ (x @ y).T + np.array([30.0, -20.0, 5.0])


@pytest.mark.parametrize("noise_mm", [0.01, 1.0])
def test_sphere_has_the_digits_of_an_exact_computation(noise_mm):
    rng = np.random.default_rng(5)
    out = rng.standard_normal((12, 3))
    out /= np.linalg.norm(out, axis=1)[:, np.newaxis]
    points = tilted(12.7 * out + rng.normal(0, noise_mm, out.shape))
    sphere = fit_sphere(points)
    fitted = [*sphere.centre_mm, sphere.radius_mm]
    exact = exact_fits.exact_minimum(exact_fits.sphere, points, fitted)
    np.testing.assert_allclose(fitted, exact, rtol=1e-13)


def test_plane_has_the_digits_of_an_exact_computation():
    rng = np.random.default_rng(6)
    points = tilted(rng.normal(0, [40.0, 30.0, 0.5], (10, 3)))
    plane = fit_plane(points)
    a, b, _ = -plane.normal / plane.normal[2]
    fitted = [a, b, plane.point_mm @ plane.normal / plane.normal[2]]
    exact = exact_fits.exact_minimum(exact_fits.plane, points, fitted)
    np.testing.assert_allclose(fitted, exact, rtol=1e-12)


def test_normals_point_to_the_positive_side():
    tube_points = tube(1, 20, 20.0, 60.0, 5.0, 0.01)
    for points in (tube_points, tube_points @ np.diag([1.0, -1.0, -1.0])):
        assert fit_plane(points * [1.0, 1.0, 0.001]).normal[2] > 0.9


LINE = np.outer(np.arange(8.0), [1.0, 2.0, 3.0])
CUBE = np.array([[x, y, z] for x in (0.0, 1) for y in (0.0, 1) for z in (0.0, 1)])


@pytest.mark.parametrize(
    ("points", "message"),
    [
        (np.eye(3)[:2], "2 points given, expected at least 3"),
        (LINE, "one line"),
        (np.ones((4, 3)), "one place"),
        (CUBE, "as thick as they are wide"),
        (np.full((5, 3), np.inf), "not finite"),
    ],
)
def test_points_that_fit_no_single_plane_are_refused(points, message):
    with pytest.raises(ValueError, match=message):
        fit_plane(points)
