"""What an alignment is made of: touches, common points, nominal files, volumes."""

import numpy as np
import pytest

from tests.lab.alignment.aligned import (
    BOX,
    WIDE,
    codes,
    common,
    transformation,
)
from traverse.kinematics.helmert.volume import Ball
from traverse.lab.alignment.best_fit import best_fit_alignment
from traverse.lab.alignment.nominal import (
    Nominal,
    fixed_volume,
    read_nominal,
    volume_from_text,
)
from traverse.lab.alignment.touches import (
    CommonPoints,
    Place,
    Touch,
    common_points,
    places_by_name,
    read_touch_table,
)
from traverse.strict_toml.problems import FileError


def touch(name, place, **more):
    return Touch((name,), np.array(place, dtype=float), **more)


def test_repeated_touches_are_a_mean_whose_error_is_not_divided():
    touches = [touch("A", (0, 0, 0)), touch("A", (0, 0, 0.2)), touch("B", (1, 1, 1))]
    places, remarks = places_by_name(touches, ["A"], std_mm=0.1, spheres=False)
    assert places["A"].touches == 2
    assert places["A"].spread_mm == pytest.approx(0.1)
    np.testing.assert_allclose(places["A"].covariance_mm2, 0.01 * np.eye(3))
    assert remarks == [
        "left out: 1 touch with a name that the other side does not know"
    ]


@pytest.mark.parametrize(("stated", "apart_mm"), [(True, 0.8), (False, 1.5)])
def test_a_name_that_was_given_twice_is_flagged(stated, apart_mm):
    points = common(WIDE, seed=2, stated=stated)
    for spread_mm, is_flagged in ((0.1, False), (apart_mm, True)):
        first = points.measured[0]
        twice = Place(first.place_mm, first.covariance_mm2, 2, spread_mm)
        measured = (twice, *points.measured[1:])
        alignment = best_fit_alignment(
            CommonPoints(points.names, measured, points.nominal), fixed_volume(BOX), ""
        )
        assert ("scattered_touches" in codes(alignment)) == is_flagged


def test_flags_of_touches_are_reported():
    touches = [touch("A", (0, 0, 0), flags=("fast",)), Touch((), np.zeros(3))]
    _, remarks = places_by_name(touches, None, std_mm=None, spheres=False)
    assert "A: touches carry flags: fast" in remarks
    assert "left out: 1 touch without a name" in remarks


def test_centres_of_spheres_are_fitted():
    ways = np.vstack([np.eye(3), -np.eye(3)])
    touches = [touch("ball", (5, 6, 7) + 12.7 * way) for way in ways]
    places, _ = places_by_name(touches, None, std_mm=0.01, spheres=True)
    np.testing.assert_allclose(places["ball"].place_mm, (5, 6, 7), atol=1e-9)
    # Each coordinate of the centre is determined by two touches.
    expected = 0.5e-4 * np.eye(3)
    np.testing.assert_allclose(places["ball"].covariance_mm2, expected, atol=1e-12)
    with pytest.raises(ValueError, match=r"ball: .*at least 4"):
        places_by_name(touches[:3], None, std_mm=0.01, spheres=True)


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
    where = [problem.where for problem in refused.value.problems]
    assert where == ["line 2, column z_mm", "line 3, column z_mm", "line 4"]
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
    ("volume", "message"),
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
def test_volumes_that_are_none_are_refused(volume, message):
    with pytest.raises(ValueError, match=message):
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
