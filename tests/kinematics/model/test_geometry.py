from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.kinematics.arms import ARM_TEXT, random_geometry, seeds
from traverse.kinematics.arm_file.arm import parse_arm
from traverse.kinematics.model.geometry import Geometry, geometry_from_arm, unit_vectors
from traverse.kinematics.model.quaternion import (
    chain_rotations,
    conjugate,
    multiply,
    rotate,
    turn,
)

X, Y, Z = np.eye(3)


@given(seeds, st.floats(-10, 10))
def test_rotation_agrees_with_rodrigues_formula(seed, angle):
    rng = np.random.default_rng(seed)
    axis, vector = unit_vectors(rng.normal(size=3)), rng.normal(size=3)
    expected = (
        np.cos(angle) * vector
        + np.sin(angle) * np.cross(axis, vector)
        + (1 - np.cos(angle)) * (axis @ vector) * axis
    )
    turned = rotate(turn(axis, np.array([angle])), vector[:, np.newaxis])
    np.testing.assert_allclose(turned[:, 0], expected, atol=1e-14)


@given(seeds)
def test_product_rotates_by_the_right_factor_first(seed):
    rng = np.random.default_rng(seed)
    p = turn(unit_vectors(rng.normal(size=3)), rng.uniform(-4, 4, 6))
    q = turn(unit_vectors(rng.normal(size=3)), rng.uniform(-4, 4, 6))
    vectors = rng.normal(size=(3, 6))
    np.testing.assert_allclose(
        rotate(multiply(p, q), vectors), rotate(p, rotate(q, vectors)), atol=1e-14
    )


@given(seeds)
def test_chains_go_outwards_and_conjugates_back(seed):
    rng = np.random.default_rng(seed)
    axes = unit_vectors(rng.normal(size=(7, 3))).T[:, :, np.newaxis]
    turns = turn(axes, rng.normal(scale=2.0, size=(7, 30)))
    rotations = chain_rotations(turns)
    vectors = rng.normal(size=(3, 7, 1))
    turned = vectors[:, 0]
    for k in reversed(range(7)):
        turned = rotate(turns[:, k], turned)
    at_once = rotate(rotations[:, -1], vectors[:, 0])
    np.testing.assert_allclose(at_once, turned, atol=1e-12)
    back = rotate(conjugate(rotations), rotate(rotations, vectors))
    np.testing.assert_allclose(back, np.broadcast_to(vectors, back.shape), atol=1e-12)


def test_geometry_comes_from_the_arm_file_with_unit_axes():
    geometry = geometry_from_arm(parse_arm(ARM_TEXT))
    assert geometry.origin_mm.tolist() == [1.0, -2.0, 3.5]
    assert geometry.axes.tolist() == [[0.0, 0.0, 1.0], [0.0, 1.0, 0.0]]
    assert geometry.links_mm.tolist() == [[0.0, 10.0, 250.0], [0.0, 0.0, 300.0]]
    assert geometry.zeros_rad.tolist() == [1.234, -0.5]
    assert geometry.probe_vector_mm.tolist() == [0.0, 0.0, 50.0]
    assert geometry.probe_direction.tolist() == [0.0, 0.0, 1.0]
    assert geometry.n_joints == 2


def test_direction_is_normalised():
    text = ARM_TEXT.replace("[0.0, 0.0, 1.0]", "[0.0, 3.0, 4.0]")
    direction = geometry_from_arm(parse_arm(text)).probe_direction
    np.testing.assert_allclose(direction, [0.0, 0.6, 0.8], rtol=1e-15)


def test_default_direction_is_along_the_last_link_and_the_probe_vector():
    text = ARM_TEXT.replace("direction = [0.0, 0.0, 1.0]\n", "")
    text = text.replace("[0.0, 0.0, 50.0]", "[400.0, 0.0, 0.0]")
    direction = geometry_from_arm(parse_arm(text)).probe_direction
    np.testing.assert_allclose(direction, [0.8, 0.0, 0.6], rtol=1e-15)


@given(st.lists(st.floats(-1e308, 1e308), min_size=3, max_size=3).filter(any))
def test_unit_vectors_have_length_one_at_any_scale(vector):
    unit = unit_vectors(vector)
    assert np.linalg.norm(unit) == pytest.approx(1.0, rel=1e-15)
    largest = np.argmax(np.abs(vector))
    assert np.sign(unit[largest]) == np.sign(vector[largest])


@pytest.mark.parametrize("vector", [[0.0, 0.0, -0.0], [np.nan, 1, 0], [np.inf, 1, 0]])
def test_vectors_without_a_length_are_refused(vector):
    with pytest.raises(ValueError, match="finite length above zero"):
        unit_vectors(vector)


def test_arrays_are_own_and_read_only():
    links = np.ones((3, 3))
    geometry = replace(random_geometry(seed=1, n_joints=3), links_mm=links)
    links[:] = 7.0
    assert geometry.links_mm.tolist() == np.ones((3, 3)).tolist()
    with pytest.raises(ValueError, match="read-only"):
        geometry.links_mm[0, 0] = 2.0


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("axes", np.ones((3, 3))),
        ("axes", np.ones(3)),
        ("axes", np.ones((0, 3))),
        ("links_mm", np.ones((2, 3))),
        ("zeros_rad", np.ones((3, 1))),
        ("origin_mm", np.ones(2)),
        ("probe_direction", np.zeros(3)),
    ],
)
def test_arrays_that_do_not_fit_are_refused_by_name(name, value):
    fields = {
        field: getattr(random_geometry(seed=1, n_joints=3), field)
        for field in Geometry.__dataclass_fields__
    }
    with pytest.raises(ValueError, match=f"geometry: {name}"):
        Geometry(**{**fields, name: value})
