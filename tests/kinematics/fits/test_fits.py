"""The smallest enclosing sphere: by its optimality, by trying everything."""

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.kinematics.arms import seeds
from traverse.kinematics.fits import (
    enclosing_sphere,
    fit_sphere,
    fit_sphere_of_radius,
    spread_about_mean,
)

CENTRE = np.array([800.0, -250.0, 120.0])
OCTAHEDRON = np.vstack([np.eye(3), -np.eye(3)])


def on_a_cap(seed, n_points, radius_mm, half_angle_rad=np.pi / 2):
    """Points of a sphere about CENTRE, up to an angle from its pole."""
    rng = np.random.default_rng(seed)
    z = rng.uniform(np.cos(half_angle_rad), 1.0, n_points)
    azimuth = rng.uniform(0, 2 * np.pi, n_points)
    across = np.sqrt(1 - z**2)
    unit = np.stack([across * np.cos(azimuth), across * np.sin(azimuth), z], axis=1)
    return CENTRE + radius_mm * unit


def gradient(points, centre, radius):
    """Derivatives of half the sum of squares, by definition zero at the best fit."""
    outwards = points - centre
    distances = np.linalg.norm(outwards, axis=1)
    misclosures = distances - radius
    by_centre = -(misclosures[:, np.newaxis] * outwards / distances[:, np.newaxis])
    return by_centre.sum(axis=0), -misclosures.sum()


@given(seeds, st.integers(8, 60), st.floats(1.0, 500.0))
def test_exact_points_give_the_sphere_back(seed, n_points, radius):
    points = on_a_cap(seed, n_points, radius)
    for sphere in (fit_sphere(points), fit_sphere_of_radius(points, radius)):
        np.testing.assert_allclose(sphere.centre_mm, CENTRE, rtol=0, atol=1e-7)
        assert sphere.radius_mm == pytest.approx(radius, abs=1e-7)
        assert sphere.rms_mm < 1e-9


@given(seeds)
def test_noisy_points_give_the_least_squares_sphere(seed):
    points = on_a_cap(seed, 40, 25.4)
    points = points + np.random.default_rng(seed).normal(0, 0.01, points.shape)
    sphere = fit_sphere(points)
    by_centre, by_radius = gradient(points, sphere.centre_mm, sphere.radius_mm)
    np.testing.assert_allclose([*by_centre, by_radius], 0.0, atol=1e-9)
    sphere = fit_sphere_of_radius(points, 25.4)
    assert sphere.radius_mm == 25.4
    by_centre, _ = gradient(points, sphere.centre_mm, 25.4)
    np.testing.assert_allclose(by_centre, 0.0, atol=1e-9)


def test_rms_by_hand():
    # Six points at distances 10 +- 0.1 in pairs across: centre and radius stay.
    lengths = np.array([10.1, 10.1, 9.9, 10.1, 10.1, 9.9])
    points = CENTRE + OCTAHEDRON * lengths[:, np.newaxis]
    sphere = fit_sphere(points)
    np.testing.assert_allclose(sphere.centre_mm, CENTRE, atol=1e-10)
    mean = (4 * 10.1 + 2 * 9.9) / 6
    assert sphere.radius_mm == pytest.approx(mean, abs=1e-10)
    rms = np.sqrt((4 * (10.1 - mean) ** 2 + 2 * (9.9 - mean) ** 2) / 6)
    assert sphere.rms_mm == pytest.approx(rms, abs=1e-10)
    known = fit_sphere_of_radius(points, 10.0)
    assert known.rms_mm == pytest.approx(0.1, abs=1e-10)


def test_four_points_are_enough():
    corners = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
    sphere = fit_sphere(CENTRE + corners)
    np.testing.assert_allclose(sphere.centre_mm, CENTRE, atol=1e-12)
    assert sphere.radius_mm == pytest.approx(np.sqrt(3), abs=1e-12)


def of_radius_one(points):
    return fit_sphere_of_radius(points, 1.0)


@pytest.mark.parametrize("fit", [fit_sphere, of_radius_one])
@pytest.mark.parametrize(
    ("points", "message"),
    [
        (np.eye(3), "3 points given, expected at least 4"),
        (np.empty((0, 3)), "0 points given"),
        (np.ones((5, 2)), "shape"),
        (np.full((5, 3), np.nan), "not finite"),
        (np.ones((5, 3)), "one plane"),
        (np.array([[1, 0, 3], [0, 1, 3], [-1, 0, 3], [0, -1, 3]]), "one plane"),
        (np.outer(np.arange(6), [1.0, 2.0, 3.0]), "one plane"),
    ],
)
def test_points_that_fit_no_single_sphere_are_refused(fit, points, message):
    with pytest.raises(ValueError, match=message):
        fit(points)


@pytest.mark.parametrize("radius", [0.0, -1.0, np.nan, np.inf])
def test_radius_must_be_a_length(radius):
    with pytest.raises(ValueError, match="radius_mm"):
        fit_sphere_of_radius(OCTAHEDRON, radius)


def test_spread_by_hand():
    points = CENTRE + np.array([[3.0, 0, 0], [-1.0, 0, 0], [-1.0, 0, 0], [-1.0, 0, 0]])
    spread = spread_about_mean(points)
    np.testing.assert_allclose(spread.mean_mm, CENTRE, atol=1e-12)
    assert spread.max_deviation_mm == pytest.approx(3.0, abs=1e-12)
    assert spread.rms_mm == pytest.approx(np.sqrt(3.0), abs=1e-12)


def test_spread_of_one_point_is_nothing():
    spread = spread_about_mean(CENTRE[np.newaxis])
    assert (spread.max_deviation_mm, spread.rms_mm) == (0.0, 0.0)
    with pytest.raises(ValueError, match="at least 1"):
        spread_about_mean(np.empty((0, 3)))


def by_trying_everything(points):
    """The smallest of all spheres through two, three or four points around all."""
    best = np.inf
    for size in (2, 3, 4):
        for subset in combinations(points, size):
            corner, *corners = np.array(subset)
            edges = np.array(corners) - corner
            gram = edges @ edges.T
            if np.linalg.matrix_rank(gram, tol=1e-9) < len(edges):
                continue
            offset = np.linalg.solve(2 * gram, np.diag(gram)) @ edges
            radius = np.linalg.norm(offset)
            away = np.linalg.norm(points - corner - offset, axis=1)
            if np.all(away <= radius * (1 + 1e-9)):
                best = min(best, radius)
    return best


@settings(max_examples=40)
@given(seeds, st.integers(2, 9), st.booleans())
def test_none_is_smaller(seed, n_points, on_a_grid):
    rng = np.random.default_rng(seed)
    points = rng.normal(0, 10, (n_points, 3))
    if on_a_grid:  # many ties, coplanar, collinear and coinciding points
        points = np.round(points / 8.0)
    sphere = enclosing_sphere(points)
    if np.ptp(points, axis=0).max() == 0.0:
        assert sphere.radius_mm == 0.0
        return
    assert sphere.radius_mm == pytest.approx(by_trying_everything(points), rel=1e-9)


@given(seeds, st.integers(5, 300), st.sampled_from([0.0, 1e-9, 1.0]))
def test_supports_hold_the_sphere(seed, n_points, depth):
    # Optimal: all inside, the centre a mean of supports with weights above 0.
    rng = np.random.default_rng(seed)
    out = rng.standard_normal((n_points, 3))
    out /= np.linalg.norm(out, axis=1)[:, np.newaxis]
    points = [800.0, -300, 50] + 0.03 * out * (
        1 - depth * rng.uniform(size=(n_points, 1))
    )
    sphere = enclosing_sphere(points)
    away = np.linalg.norm(points - sphere.centre_mm, axis=1)
    assert away.max() <= sphere.radius_mm + 1e-12
    held = points[list(sphere.supports)] - sphere.centre_mm
    np.testing.assert_allclose(
        np.linalg.norm(held, axis=1), sphere.radius_mm, atol=1e-11
    )
    weights = np.linalg.lstsq(
        np.vstack([held.T, np.full(len(held), 0.03)]), [0, 0, 0, 0.03], rcond=None
    )[0]
    assert np.all(weights > -1e-6)
    np.testing.assert_allclose(weights @ held, 0.0, atol=1e-9)


def test_points_are_checked():
    with pytest.raises(ValueError, match="at least 1"):
        enclosing_sphere(np.empty((0, 3)))
    with pytest.raises(ValueError, match="not finite"):
        enclosing_sphere(np.array([[0.0, np.nan, 0.0]]))
