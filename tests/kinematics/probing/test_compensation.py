import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from traverse.kinematics.probing.compensation import (
    METHODS,
    DirectionError,
    surface_point,
    towards_material,
)

units = (
    st.tuples(st.floats(-1, 1), st.floats(-1, 1), st.floats(-1, 1))
    .map(np.array)
    .filter(lambda v: np.linalg.norm(v) > 0.1)
    .map(lambda v: v / np.linalg.norm(v))
)


@given(units, st.floats(0.5, 20), st.floats(0.2, 100))
def test_a_sphere_touched_from_outside_or_inside_has_its_own_radius(
    normal, radius_mm, way_mm
):
    middle, size_mm, shank = np.array([3.0, -4.0, 5.0]), 50.0, np.array([0.0, 0, 1])
    outer = middle + (size_mm + radius_mm) * normal
    in_air = outer + way_mm * normal
    for method, other in (
        ("pretouch", in_air),
        ("pulled", in_air),
        ("outside", middle),
    ):
        to_material = towards_material(method, outer, shank, other)
        touched = surface_point(outer, to_material, radius_mm)
        np.testing.assert_allclose(touched, middle + size_mm * normal, atol=1e-10)
    inner = middle + (size_mm - radius_mm) * normal
    to_material = towards_material("inside", inner, shank, middle)
    touched = surface_point(inner, to_material, radius_mm)
    np.testing.assert_allclose(touched, middle + size_mm * normal, atol=1e-10)


def test_the_shank_points_at_the_material():
    shank = np.array([0.0, 0.6, -0.8])
    to_material = towards_material("shank", np.zeros(3), shank, None)
    np.testing.assert_allclose(
        surface_point(np.zeros(3), to_material, 3.0), [0, 1.8, -2.4]
    )


@pytest.mark.parametrize("method", [m for m in METHODS if m != "shank"])
@pytest.mark.parametrize(
    "other_mm", [None, np.array([1.0, 2.0, 3.05]), np.full(3, np.nan)]
)
def test_a_direction_that_does_not_follow_is_refused(method, other_mm):
    with pytest.raises(DirectionError, match=f"^{method}: "):
        towards_material(method, np.array([1.0, 2.0, 3.0]), np.eye(3)[2], other_mm)
