"""3-2-1 against the hand, and its covariance against many drawn touches."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.lab.alignment.aligned import values_of
from traverse.kinematics.helmert.transformation import Helmert
from traverse.lab.alignment.nominal import Nominal, volume_from_text
from traverse.lab.alignment.plane_line_point import align_plane_line_point
from traverse.lab.alignment.touches import Touch

NOMINAL = Nominal.model_validate(
    {
        "schema": "traverse/nominal/1",
        "plane": {"feature": "top", "point_mm": (0, 0, 50), "normal": (0, 0, 2)},
        "line": {"feature": "front", "point_mm": (0, 7, 30), "direction": (1, 0, 0)},
        "point": {"feature": "left", "point_mm": (-3, 100, 30)},
    }
)
TOP = np.array([[10.0, 20, 50], [400, 30, 50], [380, 250, 50], [20, 240, 50]])
FRONT = np.array([[20.0, 7, 30], [200, 7, 31], [390, 7, 29]])
LEFT = np.array([[-3.0, 100, 30]])
BOX = volume_from_text("0,0,0,400,300,50", None)


def touches(transformation, noise=0.0, rng=None, shanks=True, top=TOP):
    back = transformation.inverse()
    down = transformation.rotation.T @ [0.0, 0.1, -0.9]
    drawn = []
    for name, places in (("top", top), ("front", FRONT), ("left", LEFT)):
        for place in back.places_mm(places):
            off = 0.0 if rng is None else rng.normal(0.0, noise, 3)
            drawn.append(Touch((name,), place + off, shank=down if shanks else None))
    return drawn


def drawn():
    rotation = Rotation.from_euler("xyz", [0.4, -1.2, 2.0]).as_matrix()
    return Helmert(rotation, np.array([300.0, -50.0, 120.0]))


def aligned(touches, std_mm=0.01):
    return align_plane_line_point(touches, NOMINAL, BOX, "test", std_mm=std_mm)


@pytest.mark.parametrize("shanks", [True, False])
def test_exact_touches_give_the_exact_alignment(shanks):
    true = drawn()
    alignment = aligned(touches(true, shanks=shanks))
    np.testing.assert_allclose(
        alignment.transformation.rotation, true.rotation, atol=1e-12
    )
    np.testing.assert_allclose(
        alignment.transformation.translation_mm, true.translation_mm, atol=1e-9
    )
    assert [f["redundancy"] for f in alignment.features] == [1, 1, 0]
    assert alignment.test.redundancy == 2


def test_by_hand_a_part_beside_the_arm():
    nominal = Nominal.model_validate(
        {
            "schema": "traverse/nominal/1",
            "plane": {"feature": "t", "point_mm": (9, 9, 0), "normal": (0, 0, 1)},
            "line": {"feature": "l", "point_mm": (5, 0, 0), "direction": (1, 0, 0)},
            "point": {"feature": "p", "point_mm": (0, 5, 0)},
        }
    )
    # The part's x is the arm's y, its y the arm's -x; its origin at 10, 20, 30.
    places = {
        "t": [(10, 20, 30), (10, 80, 30), (-40, 20, 30)],
        "l": [(10, 30, 25), (10, 70, 25)],
        "p": [(0, 20, 25)],
    }
    touches = [
        Touch((name,), np.array(place, dtype=float), shank=np.array([0.0, 0, -1]))
        for name, group in places.items()
        for place in group
    ]
    alignment = align_plane_line_point(touches, nominal, BOX, "", std_mm=0.01)
    expected = [[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]]
    np.testing.assert_allclose(alignment.transformation.rotation, expected, atol=1e-15)
    moved = alignment.transformation.places_mm(np.array([[10.0, 20, 30]]))
    np.testing.assert_allclose(moved, np.zeros((1, 3)), atol=1e-13)
    assert alignment.test is None
    assert {flag.code for flag in alignment.flags} >= {"no_redundancy"}


def test_the_covariance_is_the_scatter_of_many_alignments():
    true, rng, std_mm = drawn(), np.random.default_rng(1), 0.02
    n = 400
    errors, squares = np.empty((n, 6)), np.empty(n)
    for row in range(n):
        alignment = aligned(touches(true, std_mm, rng), std_mm)
        centre = alignment.centre_mm
        at = true.inverse().places_mm(centre[None])
        errors[row, :3] = alignment.transformation.places_mm(at)[0] - centre
        off = alignment.transformation.rotation @ true.rotation.T
        errors[row, 3:] = Rotation.from_matrix(off).as_rotvec()
        squares[row] = alignment.test.sigma0**2 * alignment.test.redundancy
    covariance = aligned(touches(true), std_mm).covariance
    normalised = np.einsum("ni,ij,nj->n", errors, np.linalg.inv(covariance), errors)
    assert np.mean(normalised) == pytest.approx(6.0, rel=0.12)
    assert np.mean(squares) == pytest.approx(2.0, rel=0.2)
    volume = BOX(true)
    inside = rng.uniform(volume.low_mm, volume.high_mm, (500, 3))
    away = inside - aligned(touches(true)).centre_mm
    observed = np.mean(
        [np.mean(np.sum((e[:3] + np.cross(e[3:], away)) ** 2, axis=1)) for e in errors]
    )
    quality = values_of(aligned(touches(true), std_mm))["quality"]
    predicted = quality["predicted_error_mm"]["rms"]
    assert np.sqrt(observed) == pytest.approx(predicted, rel=0.1)


def test_which_side_is_up_has_to_be_told():
    true = drawn()
    flat = NOMINAL.model_copy(
        update={
            "line": NOMINAL.line.model_copy(update={"point_mm": (0.0, 7.0, 50.0)}),
            "point": NOMINAL.point.model_copy(update={"point_mm": (-3.0, 100.0, 50.0)}),
        }
    )
    with pytest.raises(ValueError, match="side of the plane is not told"):
        align_plane_line_point(touches(true, shanks=False), flat, BOX, "", std_mm=0.01)


def test_what_is_missing_is_named_all_at_once():
    with pytest.raises(ValueError, match=r"plane 'top' has 0.*line 'front'.*'left'"):
        aligned([])
    with pytest.raises(ValueError, match=r"3-2-1 needs \[line\], \[point\]"):
        align_plane_line_point(
            [],
            NOMINAL.model_copy(update={"line": None, "point": None}),
            BOX,
            "",
            std_mm=None,
        )


def test_a_plane_touched_along_a_line_is_flagged_or_refused():
    true = drawn()
    narrow = np.array([[10.0, 20, 50], [400, 30, 50], [200, 20, 50]])
    alignment = aligned(touches(true, top=narrow))
    assert "nearly_collinear" in {flag.code for flag in alignment.flags}
    narrower = np.array([[10.0, 20, 50], [400, 20.1, 50], [200, 20, 50]])
    with pytest.raises(ValueError, match="undetermined"):
        aligned(touches(true, top=narrower))


def test_touches_that_nothing_checks_are_blind():
    alignment = aligned(touches(drawn(), top=TOP[:3]))
    assert [p.detectable_mm.best is None for p in alignment.points] == [
        *([True] * 3),
        *([False] * 3),
        True,
    ]
    assert "blind_directions" in {flag.code for flag in alignment.flags}


def test_centres_of_a_ball_are_flagged_as_they_are_no_surface():
    centres = [
        Touch(t.names, t.place_mm, shank=t.shank, off_mm=3.0) for t in touches(drawn())
    ]
    flags = {flag.code: flag.text for flag in aligned(centres).flags}
    assert "ball of 3 mm radius" in flags["ball_centres"]
    assert "ball_centres" not in {flag.code for flag in aligned(touches(drawn())).flags}
