"""The Helmert transformation against other formulas: Kabsch, Umeyama, differences."""

from contextlib import suppress

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from traverse.kinematics.helmert.adjustment import (
    HelmertError,
    adjusted_helmert,
    point_statistics,
    reliability_of,
)
from traverse.kinematics.helmert.shape import shape_of, undetermined
from traverse.kinematics.helmert.transformation import (
    Helmert,
    closed_helmert,
    mirrored_share,
    motions,
    moved_centre,
)
from traverse.kinematics.model.quaternion import rotation_matrix, small_turn

SEEDS = st.integers(0, 2**32 - 1)


def drawn(rng, n, extent_mm=500.0):
    return rng.uniform(-extent_mm, extent_mm, (n, 3))


def drawn_transformation(rng, scale=1.0):
    rotation = Rotation.random(random_state=int(rng.integers(2**31))).as_matrix()
    return Helmert(rotation, rng.uniform(-1000.0, 1000.0, 3), scale)


def drawn_covariances(rng, n, size_mm=0.02):
    root = rng.normal(0.0, size_mm, (n, 3, 3))
    return root @ np.swapaxes(root, 1, 2) + 1e-6 * np.eye(3)


def with_shared(covariances, shared):
    return covariances + shared @ np.swapaxes(shared, 1, 2)


def noise(rng, covariances):
    return np.einsum(
        "nij,nj->ni",
        np.linalg.cholesky(covariances),
        rng.normal(size=(len(covariances), 3)),
    )


def test_seven_parameters_published_by_ghilani():
    """Adjustment Computations, the example of a three-dimensional transformation.

    With the errors of both sides another program, for general least squares, states
    the scale 0.9499549354 of these points.
    """
    measured = np.array(
        [
            [1094.883, 820.085, 109.821],
            [503.891, 1598.698, 117.685],
            [2349.343, 207.658, 151.387],
            [1395.320, 1348.853, 215.261],
        ]
    )
    control = np.array(
        [
            [10037.81, 5262.09, 772.04],
            [10956.68, 5128.17, 783.00],
            [8780.08, 4840.29, 782.62],
            [10185.80, 4700.21, 851.32],
        ]
    )
    measured_std = 1e-3 * np.array([[7, 8, 5], [11, 8, 9], [6, 5, 7], [5, 8, 9]])
    control_std = 1e-2 * np.array([[5, 6, 5], [4, 6, 9], [2, 4, 2], [3, 5, 3]])
    covariances = [
        np.einsum("ni,ij->nij", std**2, np.eye(3))
        for std in (measured_std, control_std)
    ]
    adjusted = adjusted_helmert(measured, control, *covariances, with_scale=True)
    assert adjusted.transformation.scale == pytest.approx(0.9499549354, abs=1e-10)
    assert adjusted.redundancy == 5


@settings(max_examples=50)
@given(SEEDS)
def test_the_rotation_is_that_of_scipy(seed):
    rng = np.random.default_rng(seed)
    a = drawn(rng, 6)
    b = drawn_transformation(rng).places_mm(a) + rng.normal(0, 5.0, a.shape)
    weights = rng.uniform(0.1, 3.0, 6)
    fitted = closed_helmert(a, b, weights, with_scale=False)
    w = weights / weights.sum()
    expected, _ = Rotation.align_vectors(b - w @ b, a - w @ a, weights=weights)
    np.testing.assert_allclose(fitted.rotation, expected.as_matrix(), atol=1e-9)
    np.testing.assert_allclose(fitted.places_mm((w @ a)[None])[0], w @ b, atol=1e-9)


def test_with_errors_on_one_side_the_scale_is_that_of_umeyama():
    rng = np.random.default_rng(2)
    a = drawn(rng, 8)
    b = drawn_transformation(rng, 1.1).places_mm(a) + rng.normal(0, 20.0, a.shape)
    unit = np.tile(np.eye(3), (8, 1, 1))
    fitted = adjusted_helmert(a, b, 0.0 * unit, unit, with_scale=True).transformation
    x, y = a - a.mean(axis=0), b - b.mean(axis=0)
    left, sizes, right = np.linalg.svd(y.T @ x)
    sign = np.array([1.0, 1.0, np.sign(np.linalg.det(left @ right))])
    np.testing.assert_allclose(fitted.rotation, left * sign @ right, atol=1e-9)
    assert fitted.scale == pytest.approx(sizes @ sign / np.sum(x**2), rel=1e-10)


@pytest.mark.parametrize(
    ("with_scale", "rank"), [(False, 0), (True, 0), (False, 2), (True, 40)]
)
def test_the_adjustment_is_where_scipy_finds_the_least_squares_of_both_sides(
    with_scale, rank
):
    rng = np.random.default_rng(3)
    n = 5
    a_true = drawn(rng, n, 100.0)
    true = drawn_transformation(rng, 1.02 if with_scale else 1.0)
    # Errors of a hundredth of the extent: a wrong weight would show.
    ca, cb = drawn_covariances(rng, n, 1.0), drawn_covariances(rng, n, 1.5)
    fa, fb = rng.normal(0.0, 1.0, (2, n, 3, rank))
    shared = rng.normal(size=rank)
    a = a_true + noise(rng, ca) + fa @ shared
    b = true.places_mm(a_true) + noise(rng, cb) + fb @ shared
    fitted = adjusted_helmert(
        a,
        b,
        with_shared(ca, fa),
        with_shared(cb, fb),
        from_shared_mm=fa if rank else None,
        to_shared_mm=fb if rank else None,
        with_scale=with_scale,
    )
    la, lb = (np.linalg.inv(np.linalg.cholesky(c)) for c in (ca, cb))

    def residuals(x):
        """Adjusted places of one side are unknowns, too, and what all share."""
        scale = x[6] if with_scale else 1.0
        z, places = x[7 : 7 + rank], x[7 + rank :].reshape(n, 3)
        moved = scale * Rotation.from_rotvec(x[:3]).apply(places) + x[3:6]
        return np.concatenate(
            [
                np.einsum("nij,nj->ni", la, places + fa @ z - a).ravel(),
                np.einsum("nij,nj->ni", lb, moved + fb @ z - b).ravel(),
                z,
            ]
        )

    start = closed_helmert(a, b, np.ones(n), with_scale=with_scale)
    turn = Rotation.from_matrix(start.rotation).as_rotvec()
    x0 = np.concatenate(
        [turn, start.translation_mm, [start.scale], np.zeros(rank), a.ravel()]
    )
    best = least_squares(residuals, x0, xtol=1e-15, ftol=1e-15, gtol=1e-15)
    assert fitted.sum_of_squares == pytest.approx(2.0 * best.cost, rel=1e-9)
    np.testing.assert_allclose(
        fitted.transformation.rotation,
        Rotation.from_rotvec(best.x[:3]).as_matrix(),
        atol=1e-6,
    )
    np.testing.assert_allclose(fitted.transformation.translation_mm, best.x[3:6], 1e-4)
    np.testing.assert_allclose(
        fitted.from_corrections_mm, best.x[7 + rank :].reshape(n, 3) - a, atol=1e-5
    )
    corrected = fitted.transformation.places_mm(a + fitted.from_corrections_mm)
    np.testing.assert_allclose(corrected, b + fitted.to_corrections_mm, atol=1e-9)


@pytest.mark.parametrize("n_parameters", [6, 7])
def test_places_move_as_the_design_says(n_parameters):
    rng = np.random.default_rng(5)
    places, centre = drawn(rng, 4), np.array([100.0, -20.0, 3.0])
    design = motions(places - centre, n_parameters)
    step = 1e-5
    for column in range(n_parameters):
        ends = []
        for sign in (1.0, -1.0):
            xi = np.zeros(7)
            xi[column] = sign * step
            turned = (places - centre) @ rotation_matrix(small_turn(xi[3:6])).T
            ends.append(centre + xi[:3] + (1.0 + xi[6]) * turned)
        slope = (ends[0] - ends[1]) / (2.0 * step)
        np.testing.assert_allclose(design[:, :, column], slope, atol=1e-5)


@pytest.mark.parametrize("rank", [0, 4])
def test_the_covariance_is_the_scatter_of_many_adjustments(rank):
    rng = np.random.default_rng(6)
    a_true, true = drawn(rng, 4), drawn_transformation(rng)
    b_true = true.places_mm(a_true)
    ca, cb = drawn_covariances(rng, 4), drawn_covariances(rng, 4)
    fa, fb = rng.normal(0.0, 0.03, (2, 4, 3, rank))
    n = 300
    scatter, squares = np.empty((n, 6)), np.empty(n)
    for row in range(n):
        shared = rng.normal(size=rank)
        fitted = adjusted_helmert(
            a_true + noise(rng, ca) + fa @ shared,
            b_true + noise(rng, cb) + fb @ shared,
            with_shared(ca, fa),
            with_shared(cb, fb),
            from_shared_mm=fa,
            to_shared_mm=fb,
        )
        off = fitted.transformation.rotation @ true.rotation.T
        centre = fitted.centre_mm
        middle_mm = true.inverse().places_mm(centre[None])
        scatter[row, :3] = fitted.transformation.places_mm(middle_mm)[0] - centre
        scatter[row, 3:] = Rotation.from_matrix(off).as_rotvec()
        squares[row] = fitted.sum_of_squares
    normalised = np.einsum(
        "ni,ij,nj->n", scatter, np.linalg.inv(fitted.cofactors), scatter
    )
    assert np.mean(normalised) == pytest.approx(6.0, rel=0.15)
    assert np.mean(squares) == pytest.approx(6.0, rel=0.15)


def test_a_covariance_about_another_centre_gives_places_the_same_errors():
    rng = np.random.default_rng(7)
    root = rng.normal(size=(7, 7))
    covariance, place = root @ root.T, drawn(rng, 1)
    old, new = drawn(rng, 1)[0], drawn(rng, 1)[0]
    designs = [motions(place - centre, 7)[0] for centre in (old, new)]
    moved = moved_centre(covariance, old, new)
    np.testing.assert_allclose(
        designs[1] @ moved @ designs[1].T, designs[0] @ covariance @ designs[0].T
    )


@pytest.mark.parametrize("rank", [0, 3])
def test_redundancy_numbers_add_up_to_the_redundancy(rank):
    rng = np.random.default_rng(8)
    shared = rng.normal(0.0, 0.05, (6, 3, rank))
    a = drawn(rng, 6)
    ca, cb = drawn_covariances(rng, 6), drawn_covariances(rng, 6)
    b = drawn_transformation(rng).places_mm(a) + noise(rng, cb)
    for with_scale, redundancy in ((False, 12), (True, 11)):
        fitted = adjusted_helmert(
            a,
            b,
            with_shared(ca, shared),
            cb,
            from_shared_mm=shared,
            with_scale=with_scale,
        )
        assert fitted.redundancy == redundancy
        shares = reliability_of(fitted).shares
        assert shares.sum() == pytest.approx(redundancy)


@pytest.mark.parametrize("rank", [0, 3])
def test_what_is_seen_of_an_error_is_how_the_sum_of_squares_grows(rank):
    rng = np.random.default_rng(9)
    a, true = drawn(rng, 5), drawn_transformation(rng)
    b, c = true.places_mm(a), drawn_covariances(rng, 5)
    shared = rng.normal(0.0, 0.05, (5, 3, rank))
    covariances = (with_shared(c, shared), c)
    fitted = adjusted_helmert(a, b, *covariances, from_shared_mm=shared)
    seen = reliability_of(fitted)
    way = rng.normal(size=3)
    way /= np.linalg.norm(way)
    wrong = b.copy()
    wrong[2] += 1e-3 * way
    parts = seen.directions[2] @ way
    expected = 1e-6 * seen.seen_per_mm2[2] @ parts**2
    moved = adjusted_helmert(a, wrong, *covariances, from_shared_mm=shared)
    # As one point of all that was moved, its statistic is all there is.
    statistic = point_statistics(moved, reliability_of(moved))[2]
    assert statistic == pytest.approx(moved.sum_of_squares, rel=1e-3)
    assert moved.sum_of_squares == pytest.approx(expected, rel=1e-3)
    # and it moves as it says
    shift = moved.transformation.places_mm(a) - fitted.transformation.places_mm(a)
    xi = seen.moves[2] @ way * 1e-3
    np.testing.assert_allclose(shift, motions(b - fitted.centre_mm, 6) @ xi, atol=1e-8)


def test_three_points_reveal_nothing_across_their_plane():
    a = np.array([[0.0, 0, 0], [500, 0, 0], [0, 300, 0]])
    unit = 1e-4 * np.tile(np.eye(3), (3, 1, 1))
    reliability = reliability_of(adjusted_helmert(a, a, 0.0 * unit, unit))
    assert np.all(reliability.seen_per_mm2[:, 0] == 0.0)
    # The null space of each point holds the normal; and within the plane one way more
    # is not seen, as three sides are all that is checked.
    np.testing.assert_allclose(reliability.shares[:, 2], 0.0, atol=1e-9)
    assert np.all(reliability.seen_per_mm2[:, 2] > 0.0)


@pytest.mark.parametrize(
    ("points", "expected"),
    [
        ([[1.0, 2, 3]], "1 common point"),
        ([[1.0, 2, 3]] * 4, "in one place: all three rotations"),
        ([[0.0, 0, 0], [0, 700, 0]], r"2 common points on one line.*\(0.000, 1.000, 0"),
        ([[0.0, 0, 0], [1, 1, 0], [2, 2, 0], [9, 9, 0]], r"\(0.707, 0.707, 0.000\)"),
    ],
)
def test_what_is_not_determined_is_refused_by_name(points, expected):
    a = np.array(points)
    c = np.tile(np.eye(3), (len(a), 1, 1))
    with pytest.raises(HelmertError, match=expected):
        adjusted_helmert(a, a, c, c)
    b = a + np.random.default_rng(0).normal(0, 0.01, a.shape)
    with pytest.raises(HelmertError):
        adjusted_helmert(a, b, c, c)


def test_shapes_have_their_names():
    assert shape_of(np.zeros((0, 3))).kind == "none"
    flat = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 1e-4]])
    assert shape_of(flat).kind == "plane"
    assert undetermined(shape_of(flat)) is None
    assert shape_of(np.vstack([flat, [0, 0, 1]])).kind == "space"


def test_a_mirror_image_is_recognised():
    rng = np.random.default_rng(11)
    a = drawn(rng, 5)
    b = drawn_transformation(rng).places_mm(a)
    assert mirrored_share(a, b) > 1e3
    assert mirrored_share(a * [1, 1, -1], b) < 1e-3
    a[:, 2] = 0.0
    assert mirrored_share(a, a[:, [1, 0, 2]]) == pytest.approx(1.0, rel=0.1)


def test_points_without_errors_are_refused():
    a = drawn(np.random.default_rng(12), 4)
    none = np.zeros((4, 3, 3))
    with pytest.raises(ValueError, match="no errors on either side"):
        adjusted_helmert(a, a, none, none)
    flat = np.tile(np.diag([1.0, 1.0, 0.0]), (4, 1, 1))
    with pytest.raises(ValueError, match="not positive definite"):
        adjusted_helmert(a, a, none, flat)


@settings(max_examples=60)
@given(SEEDS)
def test_whatever_the_points_are_they_are_adjusted_or_refused(seed):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 7))
    b = rng.uniform(-1, 1, (n, 3)) * 10.0 ** rng.uniform(-8, 4, 3)
    size_mm = 10.0 ** rng.uniform(-5, 3)
    a = drawn_transformation(rng).inverse().places_mm(b)
    a += rng.normal(0.0, size_mm, a.shape)
    c = np.tile(size_mm**2 * np.eye(3), (n, 1, 1))
    with suppress(HelmertError):
        fitted = adjusted_helmert(a, b, c, c, with_scale=bool(rng.integers(2)))
        assert np.all(np.isfinite(fitted.cofactors))
        rotation = fitted.transformation.rotation
        np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-9)
