"""Sides, relations, decisions: with values and covariances made by hand."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from traverse.kinematics.features.figures import (
    Figure,
    Tolerance,
    angle,
    distance,
    figures_of,
)
from traverse.kinematics.features.measured import Definition, Touches, measured_features
from traverse.kinematics.features.relations import related
from traverse.kinematics.fits.elements import Element
from traverse.kinematics.uncertainty.joint_covariance import JointCovariance

STD_MM = 0.01


def errors_of(points_mm, std_mm=STD_MM) -> JointCovariance:
    n = len(points_mm)
    return JointCovariance(
        np.asarray(points_mm, dtype=float),
        np.tile(std_mm**2 * np.eye(3), (n, 1, 1)),
        np.zeros((n, 3, 0)),
    )


def element(kind, place, direction=(0, 0, 0), *, size=(0, 0), row=0) -> Element:
    by_points = np.zeros((8, 2, 3))
    by_points[:3, row] = np.eye(3)
    values = np.array([*place, *direction, *size], dtype=float)
    return Element(kind, values, by_points)


ERRORS = errors_of(np.zeros((2, 3)))
UP = (0, 0, 1)


def test_relations_of_elements():
    plate = element("plane", (0, 0, 2), UP)
    wall = element("plane", (5, 0, 0), (1, 0, 0), row=1)
    pin = element("line", (1, 1, 9), UP, row=1)
    first, second = element("point", (0, 0, 0)), element("point", (4, 2, 6), row=1)
    np.testing.assert_allclose(related("intersection", pin, plate).place_mm, [1, 1, 2])
    np.testing.assert_allclose(related("intersection", plate, pin).place_mm, [1, 1, 2])
    corner = related("intersection", plate, wall)
    assert corner.kind == "line"
    np.testing.assert_allclose(np.abs(corner.direction), [0, 1, 0])
    np.testing.assert_allclose(corner.place_mm[[0, 2]], [5, 2])
    np.testing.assert_allclose(related("symmetry", first, second).place_mm, [2, 1, 3])
    np.testing.assert_allclose(related("projection", second, plate).place_mm, [4, 2, 2])
    np.testing.assert_allclose(related("projection", pin, second).place_mm, [1, 1, 6])
    sloped = element("line", (0, 0, 0), (0.6, 0, 0.8), row=1)
    beside = element("line", (0, 3, 0), (0, 0, 1))
    between = related("intersection", sloped, beside)
    np.testing.assert_allclose(between.place_mm, [0, 1.5, 0])
    cone = element("cone", (0, 0, 10), UP, size=(5.0, np.arctan(0.5)))
    np.testing.assert_allclose(related("apex", cone).place_mm, [0, 0, 0], atol=1e-12)


@pytest.mark.parametrize(
    ("relation", "kinds", "message"),
    [
        ("intersection", ("point", "plane"), "no intersection of point and plane"),
        ("intersection", ("plane", "plane"), "parallel"),
        ("apex", ("cylinder",), "there is no apex of cylinder"),
    ],
)
def test_relations_that_do_not_exist_are_refused(relation, kinds, message):
    with pytest.raises(ValueError, match=message):
        related(relation, *(element(kind, (0, 0, 0), UP) for kind in kinds))


def test_distances_and_angles_with_their_uncertainty():
    plate = element("plane", (0, 0, 0), UP)
    centre = element("circle", (3, 4, 5), UP, row=1)
    height = distance(plate, centre, ERRORS)
    assert height.value == pytest.approx(5.0)
    assert height.std == pytest.approx(np.sqrt(2) * STD_MM)
    axis = element("cylinder", (0, 0, 7), UP)
    assert distance(centre, axis, ERRORS).value == pytest.approx(5.0)
    skew = element("line", (0, 6, 0), (1, 0, 0), row=1)
    assert distance(axis, skew, ERRORS).value == pytest.approx(6.0)
    parallel = element("line", (0, 6, 9), (0, 0, -1), row=1)
    assert distance(axis, parallel, ERRORS).value == pytest.approx(6.0)
    assert angle(axis, skew, ERRORS).value == pytest.approx(np.pi / 2)
    assert angle(axis, parallel, ERRORS).value == pytest.approx(0.0)
    assert angle(axis, plate, ERRORS).value == pytest.approx(np.pi / 2)
    with pytest.raises(ValueError, match="a point has no direction"):
        angle(axis, element("point", (0, 0, 0)), ERRORS)


def test_a_distance_of_zero_has_the_uncertainty_of_all_directions():
    """Of 20,000 draws of two places that are one, 95 % and more are within U."""
    first, second = element("point", (0, 0, 0)), element("point", (0, 0, 0), row=1)
    rng = np.random.default_rng(1)
    draws = np.linalg.norm(np.sqrt(2) * STD_MM * rng.normal(size=(20_000, 3)), axis=1)
    apart = distance(first, second, ERRORS)
    assert np.mean(draws <= apart.expanded) > 0.954
    far = distance(first, element("point", (50, 0, 0), row=1), ERRORS)
    assert far.std == pytest.approx(np.sqrt(2) * STD_MM, rel=1e-6)


def test_the_uncertainty_of_an_angle_is_that_of_its_directions():
    """Two lines through their ends, 100 mm long, turned against draws of the ends."""
    rng = np.random.default_rng(3)
    for turn_rad in (0.7, 1.2):
        ends = np.array([[0, 0, 0], [100, 0, 0]], dtype=float)
        other = 100 * np.array([[0, 0, 0], [np.cos(turn_rad), np.sin(turn_rad), 0]])
        points_mm = np.concatenate([ends, other + np.array([0, 0, 7])])
        lines = [Definition("a", "line", (0, 1)), Definition("b", "line", (2, 3))]
        features = measured_features(lines, touches_of(points_mm))
        stated = angle(*features.elements.values(), features.errors)
        assert stated.value == pytest.approx(turn_rad)
        drawn = points_mm + STD_MM * rng.normal(size=(4000, 4, 3))
        ways = drawn[:, 1::2] - drawn[:, ::2]
        ways /= np.linalg.norm(ways, axis=2, keepdims=True)
        angles = np.arccos(np.sum(ways[:, 0] * ways[:, 1], axis=1))
        assert np.std(angles) == pytest.approx(stated.std, rel=0.05)


def touches_of(points_mm, towards=None, tip_mm=2.0, std_mm=STD_MM) -> Touches:
    n = len(points_mm)
    is_measured = np.full(n, towards is not None)
    shank = np.tile([0.0, 0.0, -1.0], (n, 1))
    to = shank if towards is None else np.asarray(towards, dtype=float)
    return Touches(errors_of(points_mm, std_mm), tip_mm, 0.0, to, is_measured)


TURNS = 2 * np.pi * np.arange(8) / 8
OUT = np.column_stack([np.cos(TURNS), np.sin(TURNS), np.zeros(8)])
ROWS = tuple(range(8))


def diameter(touches, side="auto"):
    features = measured_features([Definition("bore", "circle", ROWS, side)], touches)
    if features.problems:
        return features.problems["bore"]
    figures = figures_of(features.elements["bore"], features.errors)
    return {figure.name: figure for figure in figures}["diameter"].value


def test_the_side_of_a_bore_is_taken_from_its_touches_or_has_to_be_said():
    assert diameter(touches_of(8 * OUT, OUT)) == pytest.approx(20.0)
    assert diameter(touches_of(8 * OUT, -OUT)) == pytest.approx(12.0)
    assert "say which" in diameter(touches_of(8 * OUT))
    assert diameter(touches_of(8 * OUT), "inside") == pytest.approx(20.0)
    assert diameter(touches_of(8 * OUT), "centre") == pytest.approx(16.0)
    mixed = np.where(np.arange(8)[:, None] == 3, -OUT, OUT)
    assert "some touches are from inside" in diameter(touches_of(8 * OUT, mixed))
    assert "larger than what it touched" in diameter(touches_of(1.5 * OUT), "outside")


def test_a_plane_faces_the_shank_and_a_missing_plane_is_named():
    flat = 9 * OUT + [0, 0, 2.0]
    plate = Definition("plate", "plane", ROWS)
    bore = Definition("bore", "circle", ROWS, "inside", plane="lid")
    features = measured_features([plate, bore], touches_of(flat))
    assert features.elements["plate"].place_mm[2] == pytest.approx(0.0)
    assert features.elements["plate"].direction[2] == pytest.approx(1.0)
    assert features.problems == {"bore": "lid is no plane that was measured before"}


def test_form_beyond_the_stated_noise_widens_the_uncertainty():
    lobed = (8 + 0.2 * np.cos(3 * TURNS))[:, None] * OUT
    stds = []
    for points_mm in (8 * OUT, lobed):
        touches = touches_of(points_mm, OUT, std_mm=0.001)
        features = measured_features([Definition("b", "circle", ROWS)], touches)
        figures = figures_of(features.elements["b"], features.errors)
        stds.append({figure.name: figure for figure in figures}["diameter"].std)
    assert stds[0] == pytest.approx(2 * 0.001 / np.sqrt(8))
    assert stds[1] > 30 * stds[0]


@given(
    value=st.floats(-2, 2),
    std=st.floats(1e-6, 1),  # not lost in the rounding of the value
    lower=st.floats(-1, 0),
    upper=st.floats(0, 1),
)
def test_decisions_leave_the_uncertainty_on_both_sides(value, std, lower, upper):
    figure, tolerance = Figure("x", 5 + value, std), Tolerance(5.0, lower, upper)
    decision = tolerance.conformity(figure)
    u = figure.expanded
    ends = [replace(figure, value=figure.value + move, std=0.0) for move in (-u, u)]
    within = [tolerance.conformity(end) == "conforming" for end in ends]
    if decision == "conforming":
        assert all(within)
    elif decision == "not conforming":
        assert not any(within)
    else:
        assert not all(within)
