"""Errors in a volume: closed forms against sums over many places."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from traverse.kinematics.helmert.volume import (
    Ball,
    Box,
    disposition_index,
    place_covariances,
    volume_error,
)

SEEDS = st.integers(0, 2**32 - 1)


def covariance(rng, n_parameters):
    root = rng.normal(size=(n_parameters, n_parameters))
    units = np.array([1.0, 1, 1, 0.01, 0.01, 0.01, 0.01])[:n_parameters]
    return units[:, None] * (root @ root.T) * units


def traces(places, centre, cov):
    return np.einsum("nii->n", place_covariances(places, centre, cov))


@settings(max_examples=15)
@given(SEEDS, st.sampled_from([6, 7]))
def test_the_mean_over_a_box_is_that_of_gauss_points(seed, n_parameters):
    rng = np.random.default_rng(seed)
    low = rng.uniform(-500, 0, 3)
    box = Box(low, low + rng.uniform(1, 900, 3))
    cov, centre = covariance(rng, n_parameters), rng.uniform(-300, 300, 3)
    # Two Gauss points a side integrate quadratic functions exactly.
    places = box.mean_mm + (box.corners_mm - box.mean_mm) / np.sqrt(3.0)
    error = volume_error(box, centre, cov)
    assert error.rms_mm**2 == pytest.approx(np.mean(traces(places, centre, cov)))
    inside = rng.uniform(box.low_mm, box.high_mm, (300, 3))
    assert error.max_mm**2 >= traces(inside, centre, cov).max()
    assert error.max_mm**2 == pytest.approx(traces(box.corners_mm, centre, cov).max())


@settings(max_examples=15)
@given(SEEDS, st.sampled_from([6, 7]))
def test_nowhere_in_a_ball_is_the_error_larger_than_the_largest(seed, n_parameters):
    rng = np.random.default_rng(seed)
    ball = Ball(rng.uniform(-500, 500, 3), 400.0)
    cov, centre = covariance(rng, n_parameters), rng.uniform(-300, 300, 3)
    error = volume_error(ball, centre, cov)
    ways = rng.normal(size=(4000, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    around = traces(ball.mean_mm + 400.0 * ways, centre, cov)
    assert around.max() <= error.max_mm**2 * (1.0 + 1e-9)
    assert around.max() == pytest.approx(error.max_mm**2, rel=0.05)
    away = np.linalg.norm(error.max_at_mm - ball.mean_mm)
    assert away == pytest.approx(400.0)
    # A ball's mean: shells of radius r have the weight r^2.
    radii = 400.0 * ((np.arange(200) + 0.5) / 200)
    about = [
        np.mean(traces(ball.mean_mm + r * way * ways[:200], centre, cov))
        for r in radii
        for way in (1.0, -1.0)
    ]
    weights = np.repeat(radii**2, 2)
    mean = np.sum(weights * np.array(about)) / weights.sum()
    assert error.rms_mm**2 == pytest.approx(mean, rel=0.25)


def test_a_ball_about_the_centre_of_equal_turns_is_as_bad_everywhere():
    cov = np.diag([1.0, 1, 1, 1e-4, 1e-4, 1e-4])
    error = volume_error(Ball(np.zeros(3), 100.0), np.zeros(3), cov)
    # 3 of the shift, and 2 r^2 of turns
    assert error.max_mm == pytest.approx(np.sqrt(3.0 + 2.0 * 1e4 * 1e-4))
    assert error.rms_mm == pytest.approx(np.sqrt(3.0 + 2.0 * 1e4 * 1e-4 * 3.0 / 5.0))


def test_the_index_of_corners_of_a_cube_is_that_of_the_hand():
    cube = Box(np.full(3, -1.0), np.full(3, 1.0))
    # Eight corners: shift 1/8 a coordinate; a turn 1 / (8 * 2); in the mean 2 a turn
    # weighs 2/3, at a corner 2: 3/8 + 3 * 2/3 / 16 = 1/2, and 3/8 + 3 * 2 / 16 = 3/4.
    index = disposition_index(cube.corners_mm, cube)
    assert index.rms_mm == pytest.approx(np.sqrt(0.5 / 3.0))
    assert index.max_mm == pytest.approx(np.sqrt(0.75 / 3.0))
    # A scale: variance 1 / (8 * 3), weighs 1 in the mean.
    scaled = disposition_index(cube.corners_mm, cube, with_scale=True)
    assert scaled.rms_mm == pytest.approx(np.sqrt((0.5 + 1.0 / 24.0) / 3.0))


def test_the_index_grows_as_points_come_near_to_a_line():
    box = Box(np.zeros(3), np.array([1000.0, 500, 300]))
    last = 0.0
    for beside_mm in (300.0, 100.0, 30.0, 10.0, 3.0):
        points = np.array(
            [[0.0, 0, 0], [300, beside_mm, 0], [600, 0, beside_mm], [1000, 0, 0]]
        )
        index_rms = disposition_index(points, box).rms_mm
        assert index_rms > last
        last = index_rms
    assert last > 30.0
