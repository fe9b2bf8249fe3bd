"""The precision that fits state, against many draws of noise."""

import numpy as np
import pytest

from tests.kinematics.fits.test_shapes import tilted, tube
from traverse.kinematics.fits import fit_plane, fit_sphere, fit_sphere_of_radius

N_DRAWS = 600
STD_MM = 0.01


def ball(n_points):
    rng = np.random.default_rng(2)
    out = rng.standard_normal((n_points, 3))
    out[:, 2] = np.abs(out[:, 2])
    return tilted(12.7 * out / np.linalg.norm(out, axis=1)[:, np.newaxis])


def of_radius(points):
    return fit_sphere_of_radius(points, 12.7)


SHAPES = {
    "sphere": (fit_sphere, ball(14), ("centre_mm", "radius_mm")),
    "sphere of known radius": (of_radius, ball(14), ("centre_mm",)),
    "plane": (fit_plane, tilted(tube(1, 12, 30, 0, 6, 3)), ("point_mm", "normal")),
}


def parameters(shape, names):
    return np.concatenate([np.atleast_1d(getattr(shape, name)) for name in names])


def without_sliding(name, exact, values):
    """Points of a plane may lie anywhere in it."""
    if name == "plane":
        values[:, :3] = np.outer(values[:, :3] @ exact.normal, exact.normal)
    return values


@pytest.mark.parametrize("name", SHAPES)
def test_covariance_is_that_of_many_draws(name):
    fit, points, names = SHAPES[name]
    rng = np.random.default_rng(11)
    exact = fit(points)
    stated = exact.precision.covariance(STD_MM)
    draws, squares = [], []
    for _ in range(N_DRAWS):
        drawn = fit(points + rng.normal(0, STD_MM, points.shape))
        draws.append(parameters(drawn, names) - parameters(exact, names))
        squares.append(drawn.precision.std_mm**2)
    values = without_sliding(name, exact, np.array(draws))
    # Along every direction that is known at all, the spread of draws is that stated.
    sizes, directions = np.linalg.eigh(stated)
    known = sizes > 1e-9 * sizes[-1]
    variances = np.mean((values @ directions) ** 2, axis=0)
    bound = 5.0 * np.sqrt(2.0 / N_DRAWS)
    np.testing.assert_allclose(variances[known] / sizes[known], 1.0, atol=bound)
    assert np.all(variances[~known] < 1e-4 * sizes[-1])
    assert np.mean(squares) == pytest.approx(STD_MM**2, rel=bound)


def test_without_redundancy_there_is_no_estimate_of_the_scatter():
    corners = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1.0]])
    sphere = fit_sphere(corners)
    assert sphere.precision.std_mm is None
    assert sphere.precision.covariance(0.1).shape == (4, 4)
    with pytest.raises(ValueError, match="no redundancy"):
        sphere.precision.covariance()


def test_radius_of_evenly_spread_points_by_hand():
    # Six points along the axes: the radius is the mean of six distances.
    octahedron = np.vstack([np.eye(3), -np.eye(3)])
    cofactors = fit_sphere(10.0 * octahedron).precision.cofactors
    np.testing.assert_allclose(np.diag(cofactors), [1 / 2, 1 / 2, 1 / 2, 1 / 6])
