"""Best fit: what is flagged, refused, revealed; leapfrog joined to an alignment."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from tests.lab.alignment.aligned import (
    BOX,
    STD_MM,
    WIDE,
    codes,
    common,
    fitted,
    transformation,
    values_of,
)
from traverse.kinematics.helmert.adjustment import HelmertError
from traverse.lab.alignment.best_fit import best_fit_alignment
from traverse.lab.alignment.files import (
    WORDS,
    chained_values,
    transformation_of,
)
from traverse.lab.alignment.nominal import fixed_volume
from traverse.lab.alignment.result import global_test
from traverse.lab.alignment.touches import Place
from traverse.lab.outcomes.base import State


def aligned(points, measured, **more):
    """Fit common points that are measured elsewhere."""
    elsewhere = replace(points, measured=tuple(measured))
    return best_fit_alignment(elsewhere, fixed_volume(BOX), "of the test", **more)


NEAR_LINE = np.array([[0.0, 0, 0], [300, 20, 0], [700, 0, 25], [1000, 10, 0]])


def test_a_wide_net_has_nothing_against_it():
    fit = fitted(WIDE, seed=2)
    assert fit.is_good
    assert not fit.flags
    assert fit.outcome.state is State.GOOD
    assert values_of(fit)["verdict"] == "Usable"
    assert fit.index.rms_mm < 1.0


def test_nearly_collinear_points_are_called_so_however_small_their_residuals():
    fit = fitted(NEAR_LINE, seed=2, std_mm=0.001)
    assert codes(fit) == {"nearly_collinear", "small_for_the_volume"}
    (flag,) = (f for f in fit.flags if f.code == "nearly_collinear")
    assert abs(flag.direction[0]) > 0.999
    assert fit.index.rms_mm > 5.0 * fitted(WIDE).index.rms_mm
    assert "nearly collinear" in "\n".join(WORDS.lines("summary", values_of(fit)))


def test_points_on_a_line_within_their_errors_are_refused_with_the_direction():
    to_mm = WIDE * [1.0, 0.0001, 0.0001]
    with pytest.raises(HelmertError, match=r"line within their errors.*\(1.000, "):
        fitted(to_mm, seed=4)
    with pytest.raises(HelmertError, match=r"line within their errors.*\(1.000, "):
        fitted(to_mm, seed=4, stated=False)


def test_three_points_are_called_blind_across_their_plane():
    fit = fitted(WIDE[:3], seed=5)
    assert codes(fit) == {"coplanar", "blind_directions"}
    normal = np.cross(WIDE[1] - WIDE[0], WIDE[2] - WIDE[0])
    normal /= np.linalg.norm(normal)
    for point in fit.points:
        assert point.detectable_mm.worst is None
        assert abs(point.worst_direction @ normal) == pytest.approx(1.0)
        assert point.hidden_in_volume_mm is None
        assert point.hidden_in_volume_per_mm > 0.3


def test_a_mirrored_system_is_refused():
    points = common(WIDE)
    mirrored = [
        Place(p.place_mm * [1, 1, -1], p.covariance_mm2) for p in points.measured
    ]
    with pytest.raises(HelmertError, match="left-handed"):
        aligned(points, mirrored)


def test_a_scale_of_other_units_is_flagged():
    points = common(WIDE)
    inches = [Place(p.place_mm / 25.4, p.covariance_mm2) for p in points.measured]
    alignment = aligned(points, inches, with_scale=True)
    assert alignment.transformation.scale == pytest.approx(25.4)
    assert "unlikely_scale" in codes(alignment)


def test_part_coordinates_are_not_aligned_a_second_time():
    points, rng = common(WIDE), np.random.default_rng(5)
    aligned_before = [
        Place(p.place_mm + rng.normal(0.0, STD_MM, 3), STD_MM**2 * np.eye(3))
        for p in points.nominal
    ]
    alignment = aligned(points, aligned_before)
    assert alignment.is_good  # its residuals say nothing
    assert codes(alignment) == {"already_aligned"}
    assert alignment.outcome.state is State.DOUBT
    beside_mm = np.array([2.0, 0.0, 0.0])
    beside = [Place(p.place_mm + beside_mm, p.covariance_mm2) for p in aligned_before]
    assert codes(aligned(points, beside)) == set()


@pytest.mark.parametrize("stated", [True, False])
def test_points_that_fit_in_another_order_are_symmetric(stated):
    corners = np.array([[0.0, 0, 0], [900, 0, 0], [900, 500, 0], [0, 500, 0]])
    pairs = np.array([[200.0, 250, 300], [700, 250, 300]])
    points = common(np.concatenate([corners, pairs]), seed=3, stated=stated)
    wrong = [points.measured[row] for row in (2, 3, 0, 1, 5, 4)]
    turned = aligned(points, wrong)
    assert turned.is_good  # its residuals say nothing
    for fit in (turned, aligned(points, points.measured)):
        (flag,) = (f for f in fit.flags if f.code == "symmetric")
        assert "another order, P0 as P2, P1 as P3" in flag.text
        assert "turned by 180 degrees" in flag.text
        assert fit.outcome.state is State.DOUBT
    off = np.array([[0.0, 0, 0]] * 5 + [[1.0, 0, 0]])
    beside = common(np.concatenate([corners, pairs]) + off, seed=3, stated=stated)
    assert "symmetric" not in codes(aligned(beside, beside.measured))


@pytest.mark.parametrize("stated", [True, False])
def test_other_units_and_exchanged_names_are_named_as_causes(stated):
    points = common(WIDE * [1.0, 1.0, 0.7], seed=3, stated=stated)
    inches = [Place(p.place_mm / 25.4, p.covariance_mm2) for p in points.measured]
    with pytest.raises(HelmertError, match="measured ones are in inches"):
        aligned(points, inches)
    names = (*points.names, "far")
    far = Place(
        transformation().inverse().places_mm(np.array([[900.0, 90, 50]]))[0],
        points.measured[0].covariance_mm2,
    )
    measured = (*points.measured[1::-1], *points.measured[2:], far)
    nominal = (*points.nominal, Place(np.array([900.0, 90, 50]), None))
    with pytest.raises(HelmertError, match="names P0 and P1 are exchanged"):
        aligned(replace(points, names=names, nominal=nominal), measured)


def test_errors_that_are_not_stated_are_estimated_and_test_nothing():
    fit = fitted(WIDE, seed=6, stated=False)
    assert fit.test.p_value is None
    assert fit.is_good
    assert codes(fit) == {"errors_not_stated"}
    assert fit.test.sigma0 == pytest.approx(STD_MM, rel=0.7)
    values = values_of(fit)
    assert values["sigma0_unit"] == "mm"
    assert all(point["p_value"] is None for point in values["points"])


def test_errors_stated_for_some_points_only_are_refused():
    points = common(WIDE)
    some = (Place(points.measured[0].place_mm, None), *points.measured[1:])
    with pytest.raises(ValueError, match=r"not of these measured points: P0; .*--std"):
        aligned(points, some)


def test_a_wrong_point_fails_the_test_and_is_named():
    points = common(WIDE, seed=7)
    wrong = points.measured[2].place_mm + np.array([0.5, 0.0, 0.2])
    measured = (
        *points.measured[:2],
        Place(wrong, points.measured[2].covariance_mm2),
        *points.measured[3:],
    )
    alignment = aligned(points, measured)
    assert not alignment.is_good
    assert codes(alignment) >= {"global_test_failed", "suspect_point"}
    assert values_of(alignment)["verdict"] == "Not usable"
    assert [r["state"] for r in values_of(alignment)["reasons"]].count("bad") == 1
    # and the covariance grows with sigma0
    good = aligned(points, points.measured)
    after, before = (
        values_of(each)["quality"]["predicted_error_mm"]["rms"]
        for each in (alignment, good)
    )
    assert after / before == pytest.approx(alignment.test.sigma0, rel=0.01)


def test_an_error_of_the_detectable_size_is_found_four_times_out_of_five():
    fit = fitted(WIDE)
    point = fit.points[1]
    size_mm, way = point.detectable_mm.worst, point.worst_direction
    n, hits = 300, 0
    off = size_mm * transformation().rotation.T @ way
    for seed in range(n):
        points = common(WIDE, seed=1000 + seed)
        moved = Place(
            points.measured[1].place_mm + off, points.measured[1].covariance_mm2
        )
        measured = (points.measured[0], moved, *points.measured[2:])
        again = aligned(points, measured)
        # the residual caused by this error, in standard deviations
        seen = again.points[1].residual_mm @ way
        std = STD_MM * np.sqrt(way @ np.diag(again.points[1].redundancy) @ way)
        hits += abs(seen) / std > stats.norm.isf(0.0005) * 0.999
    assert hits / n == pytest.approx(0.8, abs=0.15)


def test_the_global_test_against_scipy():
    tested = global_test(21.0, 6, is_stated=True)
    assert tested.p_value == pytest.approx(stats.chi2.sf(21.0, 6))
    critical = stats.chi2.isf(0.05, 6)
    assert stats.ncx2.sf(critical, 6, tested.found_noncentrality) == pytest.approx(0.8)
    assert stats.chi2.sf(critical / tested.found_factor**2, 6) == pytest.approx(0.8)
    low, high = tested.interval
    assert stats.chi2.cdf(21.0 / low**2, 6) == pytest.approx(0.975)
    assert stats.chi2.cdf(21.0 / high**2, 6) == pytest.approx(0.025)
    assert global_test(0.0, 0, is_stated=True) is None


def test_a_leapfrog_joined_to_an_alignment_adds_both_errors():
    first = values_of(fitted(WIDE, seed=8))
    second = values_of(fitted(WIDE + 50.0, seed=9))
    joined = chained_values(second, first, "first.json")
    expected = transformation_of(first).after(transformation_of(second))
    transformation = transformation_of(joined)
    np.testing.assert_allclose(transformation.rotation, expected.rotation, atol=1e-15)
    np.testing.assert_allclose(transformation.translation_mm, expected.translation_mm)
    # Many drawn pairs scatter as it says, at a place.
    place = np.array([[400.0, 100.0, 200.0]])
    outer, inner = transformation_of(first), transformation_of(second)
    rng, ends = np.random.default_rng(10), []
    for _ in range(4000):
        moved = place
        for errors, step in ((second, inner), (first, outer)):
            xi = rng.multivariate_normal(np.zeros(6), errors["covariance"]["matrix"])
            moved = step.places_mm(moved)
            away = moved - errors["covariance"]["centre_mm"]
            moved = moved + xi[:3] + np.cross(xi[3:], away)
        ends.append(moved[0])
    away = (outer.after(inner).places_mm(place) - joined["covariance"]["centre_mm"])[0]
    x, y, z = away
    design = np.hstack([np.eye(3), [[0, z, -y], [-z, 0, x], [y, -x, 0]]])
    predicted = design @ np.array(joined["covariance"]["matrix"]) @ design.T
    observed = np.cov(np.array(ends).T)
    assert np.trace(observed) == pytest.approx(np.trace(predicted), rel=0.06)
    assert joined["joined_with"]["file"] == "first.json"
