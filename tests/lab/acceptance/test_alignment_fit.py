"""Best fit: what is flagged, refused, revealed; leapfrog joined to an alignment."""

import numpy as np
import pytest
from scipy import stats
from scipy.spatial.transform import Rotation

from kinematics.arm_file import FileError
from kinematics.helmert import Helmert
from kinematics.helmert_adjustment import HelmertError
from kinematics.helmert_volume import Ball, Box
from lab.acceptance.alignment_common import (
    CommonPoints,
    Place,
    common_points,
    places_by_name,
)
from lab.acceptance.alignment_file import transformation_of
from lab.acceptance.alignment_fit import fitted_alignment
from lab.acceptance.alignment_nominal import Nominal, read_nominal
from lab.acceptance.alignment_onto import joined_values
from lab.acceptance.alignment_statistics import global_test
from lab.acceptance.alignment_touches import Touch, read_touch_table
from lab.acceptance.alignment_values import alignment_values
from lab.acceptance.alignment_volume import fixed_volume, volume_from_text
from lab.acceptance.alignment_words import alignment_lines, verdict_text

BOX = Box(np.zeros(3), np.array([1000.0, 600, 400]))
WIDE = np.array([[0.0, 0, 0], [1000, 0, 100], [1000, 600, 0], [0, 600, 300]])
NEAR_LINE = np.array([[0.0, 0, 0], [300, 20, 0], [700, 0, 25], [1000, 10, 0]])
STD_MM = 0.03


def transformation(seed=1):
    rng = np.random.default_rng(seed)
    turn = Rotation.random(random_state=seed).as_matrix()
    return Helmert(turn, rng.uniform(-500, 500, 3))


def common(to_mm, seed=None, std_mm=STD_MM, stated=True):
    rng = np.random.default_rng(seed)
    from_mm = transformation().inverse().places_mm(to_mm)
    if seed is not None:
        from_mm = from_mm + rng.normal(0.0, std_mm, from_mm.shape)
    covariance = std_mm**2 * np.eye(3) if stated else None
    return CommonPoints(
        tuple(f"P{row}" for row in range(len(to_mm))),
        tuple(Place(place, covariance) for place in from_mm),
        tuple(Place(place, None) for place in to_mm),
    )


def fitted(to_mm, seed=None, **options):
    return fitted_alignment(
        common(to_mm, seed, **options), fixed_volume(BOX), "of the test"
    )


def codes(found):
    return {flag.code for flag in found.flags}


def told(found, name="part"):
    return alignment_values(found, name=name, arm=None, measured="m", nominal="n")


def test_a_wide_net_has_nothing_against_it():
    found = fitted(WIDE, seed=2)
    assert found.is_good
    assert not found.flags
    assert verdict_text(told(found)) == "Nothing speaks against it."
    assert found.index.rms_mm < 1.0


def test_nearly_collinear_points_are_called_so_however_small_their_residuals():
    found = fitted(NEAR_LINE, seed=2, std_mm=0.001)
    assert codes(found) == {"nearly_collinear", "small_for_the_volume"}
    (flag,) = (f for f in found.flags if f.code == "nearly_collinear")
    assert abs(flag.direction[0]) > 0.999
    assert found.index.rms_mm > 5.0 * fitted(WIDE).index.rms_mm
    assert "nearly collinear" in "\n".join(alignment_lines(told(found)))


def test_points_on_a_line_within_their_errors_are_refused_with_the_direction():
    to_mm = WIDE * [1.0, 0.0001, 0.0001]
    with pytest.raises(HelmertError, match=r"line within their errors.*\(1.000, "):
        fitted(to_mm, seed=4)
    with pytest.raises(HelmertError, match=r"line within their errors.*\(1.000, "):
        fitted(to_mm, seed=4, stated=False)


def test_three_points_are_called_blind_across_their_plane():
    found = fitted(WIDE[:3], seed=5)
    assert codes(found) == {"coplanar", "blind_directions"}
    normal = np.cross(WIDE[1] - WIDE[0], WIDE[2] - WIDE[0])
    normal /= np.linalg.norm(normal)
    for point in found.points:
        assert point.detectable_mm[1] is None
        assert abs(point.worst_direction @ normal) == pytest.approx(1.0)
        assert point.hidden_mm is None
        assert point.hidden_ratio > 0.3


def test_a_mirrored_system_is_refused():
    given = common(WIDE)
    mirrored = CommonPoints(
        given.names,
        tuple(
            Place(place.place_mm * [1, 1, -1], place.covariance_mm2)
            for place in given.measured
        ),
        given.nominal,
    )
    with pytest.raises(HelmertError, match="left-handed"):
        fitted_alignment(mirrored, fixed_volume(BOX), "of the test")


def test_a_scale_of_other_units_is_flagged():
    given = common(WIDE)
    inches = tuple(
        Place(place.place_mm / 25.4, place.covariance_mm2) for place in given.measured
    )
    found = fitted_alignment(
        CommonPoints(given.names, inches, given.nominal),
        fixed_volume(BOX),
        "",
        with_scale=True,
    )
    assert found.transformation.scale == pytest.approx(25.4)
    assert "unlikely_scale" in codes(found)


def test_errors_that_are_not_stated_are_estimated_and_test_nothing():
    found = fitted(WIDE, seed=6, stated=False)
    assert found.test.p_value is None
    assert found.is_good
    assert codes(found) == {"errors_not_stated"}
    assert found.test.sigma0 == pytest.approx(STD_MM, rel=0.7)
    values = told(found)
    assert values["sigma0_unit"] == "mm"
    assert all(point["p_value"] is None for point in values["points"])


def test_errors_stated_for_some_points_only_are_refused():
    given = common(WIDE)
    some = (Place(given.measured[0].place_mm, None), *given.measured[1:])
    with pytest.raises(ValueError, match=r"not of these measured points: P0; .*--std"):
        fitted_alignment(
            CommonPoints(given.names, some, given.nominal), fixed_volume(BOX), ""
        )


def test_a_wrong_point_fails_the_test_and_is_named():
    given = common(WIDE, seed=7)
    wrong = given.measured[2].place_mm + np.array([0.5, 0.0, 0.2])
    measured = (
        *given.measured[:2],
        Place(wrong, given.measured[2].covariance_mm2),
        *given.measured[3:],
    )
    found = fitted_alignment(
        CommonPoints(given.names, measured, given.nominal), fixed_volume(BOX), ""
    )
    assert not found.is_good
    assert codes(found) >= {"global_test_failed", "suspect_point"}
    assert "do not use it" in verdict_text(told(found))
    # and the covariance grows with sigma0
    good = fitted_alignment(given, fixed_volume(BOX), "")
    grown = found.predicted.rms_mm / good.predicted.rms_mm
    assert grown == pytest.approx(found.test.sigma0, rel=0.01)


def test_an_error_of_the_detectable_size_is_found_four_times_out_of_five():
    found = fitted(WIDE)
    point = found.points[1]
    size_mm, way = point.detectable_mm[1], point.worst_direction
    n, hits = 300, 0
    off = size_mm * transformation().rotation.T @ way
    for seed in range(n):
        given = common(WIDE, seed=1000 + seed)
        moved = Place(
            given.measured[1].place_mm + off, given.measured[1].covariance_mm2
        )
        measured = (given.measured[0], moved, *given.measured[2:])
        again = fitted_alignment(
            CommonPoints(given.names, measured, given.nominal), fixed_volume(BOX), ""
        )
        # the residual that is seen of this error, in standard deviations
        seen = again.points[1].residual_mm @ way
        std = STD_MM * np.sqrt(way @ np.diag(again.points[1].redundancy) @ way)
        hits += abs(seen) / std > stats.norm.isf(0.0005) * 0.999
    assert hits / n == pytest.approx(0.8, abs=0.15)


def test_the_global_test_against_scipy():
    found = global_test(21.0, 6, is_stated=True)
    assert found.p_value == pytest.approx(stats.chi2.sf(21.0, 6))
    critical = stats.chi2.isf(0.05, 6)
    assert stats.ncx2.sf(critical, 6, found.found_noncentrality) == pytest.approx(0.8)
    assert stats.chi2.sf(critical / found.found_factor**2, 6) == pytest.approx(0.8)
    low, high = found.interval
    assert stats.chi2.cdf(21.0 / low**2, 6) == pytest.approx(0.975)
    assert stats.chi2.cdf(21.0 / high**2, 6) == pytest.approx(0.025)
    assert global_test(0.0, 0, is_stated=True) is None


def test_a_leapfrog_joined_to_an_alignment_adds_both_errors():
    first = told(fitted(WIDE, seed=8))
    second = told(fitted(WIDE + 50.0, seed=9))
    joined = joined_values(second, first, "first.json")
    expected = transformation_of(first).after(transformation_of(second))
    found = transformation_of(joined)
    np.testing.assert_allclose(found.rotation, expected.rotation, atol=1e-15)
    np.testing.assert_allclose(found.translation_mm, expected.translation_mm)
    # Many drawn pairs scatter as it says, at a place.
    place = np.array([[400.0, 100.0, 200.0]])
    outer, inner = transformation_of(first), transformation_of(second)
    rng, ends = np.random.default_rng(10), []
    for _ in range(4000):
        moved = place
        for one, step in ((second, inner), (first, outer)):
            xi = rng.multivariate_normal(np.zeros(6), one["covariance"]["matrix"])
            moved = step.places_mm(moved)
            away = moved - one["covariance"]["centre_mm"]
            moved = moved + xi[:3] + np.cross(xi[3:], away)
        ends.append(moved[0])
    away = (outer.after(inner).places_mm(place) - joined["covariance"]["centre_mm"])[0]
    x, y, z = away
    design = np.hstack([np.eye(3), [[0, z, -y], [-z, 0, x], [y, -x, 0]]])
    predicted = design @ np.array(joined["covariance"]["matrix"]) @ design.T
    observed = np.cov(np.array(ends).T)
    assert np.trace(observed) == pytest.approx(np.trace(predicted), rel=0.06)
    assert joined["joined_with"]["file"] == "first.json"


def touch(name, place, **more):
    return Touch((name,), np.array(place, dtype=float), **more)


def test_repeated_touches_are_a_mean_whose_error_is_not_divided():
    given = [touch("A", (0, 0, 0)), touch("A", (0, 0, 0.2)), touch("B", (1, 1, 1))]
    found, remarks = places_by_name(given, ["A"], std_mm=0.1, spheres=False)
    assert found["A"].touches == 2
    assert found["A"].spread_mm == pytest.approx(0.1)
    np.testing.assert_allclose(found["A"].covariance_mm2, 0.01 * np.eye(3))
    assert remarks == [
        "1 touches have names that the other side does not know, and are left out"
    ]


@pytest.mark.parametrize(("stated", "apart_mm"), [(True, 0.8), (False, 1.5)])
def test_a_name_that_was_given_twice_is_flagged(stated, apart_mm):
    given = common(WIDE, seed=2, stated=stated)
    for spread_mm, is_flagged in ((0.1, False), (apart_mm, True)):
        first = given.measured[0]
        twice = Place(first.place_mm, first.covariance_mm2, 2, spread_mm)
        measured = (twice, *given.measured[1:])
        found = fitted_alignment(
            CommonPoints(given.names, measured, given.nominal), fixed_volume(BOX), ""
        )
        assert ("scattered_touches" in codes(found)) == is_flagged


def test_flags_of_touches_are_told():
    given = [touch("A", (0, 0, 0), flags=("fast",)), Touch((), np.zeros(3))]
    _, remarks = places_by_name(given, None, std_mm=None, spheres=False)
    assert "A: touches carry flags: fast" in remarks
    assert "1 touches have no name and are left out" in remarks


def test_centres_of_spheres_are_fitted():
    ways = np.vstack([np.eye(3), -np.eye(3)])
    given = [touch("ball", (5, 6, 7) + 12.7 * way) for way in ways]
    found, _ = places_by_name(given, None, std_mm=0.01, spheres=True)
    np.testing.assert_allclose(found["ball"].place_mm, (5, 6, 7), atol=1e-9)
    # Each coordinate of the centre comes from two touches.
    expected = 0.5e-4 * np.eye(3)
    np.testing.assert_allclose(found["ball"].covariance_mm2, expected, atol=1e-12)
    with pytest.raises(ValueError, match=r"ball: .*at least 4"):
        places_by_name(given[:3], None, std_mm=0.01, spheres=True)


def test_common_points_come_in_the_order_of_the_nominal_ones():
    places = {name: Place(np.zeros(3), None) for name in "ABC"}
    assert common_points({"C": places["C"], "A": places["A"]}, places).names == (
        "A",
        "C",
    )


def test_a_table_with_mistakes_is_refused_with_all_of_them(tmp_path):
    path = tmp_path / "points.csv"
    path.write_text("name,x_mm,y_mm,z_mm\nA,1,2,x\nB,1,2,inf\nC,1,2\nD,1,2,3\n")
    with pytest.raises(FileError) as refused:
        read_touch_table(path, "centre")
    assert [p.where for p in refused.value.problems] == ["line 2", "line 3", "line 4"]
    path.write_text("who,x_mm,y_mm\n")
    with pytest.raises(FileError, match=r"'z_mm' is missing(.|\n)*'name' is missing"):
        read_touch_table(path, "centre")


def test_nominal_files_in_both_forms_say_the_same(tmp_path):
    table, file = tmp_path / "n.csv", tmp_path / "n.toml"
    table.write_text("name,x_mm,y_mm,z_mm,std_mm\nA,1,2,3,0.01\nB,4,5,6,\n")
    file.write_text(
        'schema = "traverse/nominal/1"\n'
        '[[points]]\nname = "A"\nx_mm = 1.0\ny_mm = 2.0\nz_mm = 3.0\nstd_mm = 0.01\n'
        '[[points]]\nname = "B"\nx_mm = 4.0\ny_mm = 5.0\nz_mm = 6.0\n'
    )
    assert read_nominal(table).points[1] == read_nominal(file).points[1]
    assert read_nominal(table).points[0].std_mm == pytest.approx(0.01)
    table.write_text("name,x_mm,y_mm,z_mm\nA,1,2,3\nA,4,5,6\n")
    with pytest.raises(FileError, match="points named twice: A"):
        read_nominal(table)


@pytest.mark.parametrize(
    ("volume", "said"),
    [
        ({"min_mm": (0, 0, 0)}, "min_mm and max_mm, or"),
        ({"min_mm": (0, 0, 0), "max_mm": (1, 1, -1)}, "not above"),
        ({"centre_mm": (0, 0, 0)}, "min_mm and max_mm, or"),
        (
            {"min_mm": (0, 0, 0), "max_mm": (1, 1, 1), "radius_mm": 3.0},
            "min_mm and max_mm, or",
        ),
    ],
)
def test_volumes_that_are_none_are_refused(volume, said):
    with pytest.raises(ValueError, match=said):
        Nominal.model_validate({"schema": "traverse/nominal/1", "volume": volume})


def test_volumes_are_read_from_text():
    box = volume_from_text("1,2,3,0,0,0", None)(transformation())
    np.testing.assert_array_equal(box.high_mm, (1, 2, 3))
    ball = volume_from_text("1,2,3,50", None)(transformation())
    assert isinstance(ball, Ball)
    for wrong in ("", "1,2", "1,2,3,-5", "a,b,c,d", "0,0,0,0,0,0", "1,2,3,nan"):
        with pytest.raises(ValueError, match="six numbers"):
            volume_from_text(wrong, None)
    with pytest.raises(ValueError, match="--arm"):
        volume_from_text("reach", None)
