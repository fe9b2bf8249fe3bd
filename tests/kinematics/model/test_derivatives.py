"""Closed-form derivatives against central differences and exact invariances."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.kinematics.arms import geometries, random_geometry, seeds, size_mm
from traverse.kinematics.model.derivatives import derivative_chunks, probe_derivatives
from traverse.kinematics.model.forward import probe_centre
from traverse.kinematics.model.geometry import Coupling, Geometry, unit_vectors

STEP = 1e-5
RELATIVE = 1e-7


def _angles(seed: int, geometry: Geometry, n_samples: int = 5) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return rng.uniform(-7, 7, (n_samples, geometry.n_joints))


def _changed(geometry: Geometry, field: str, index: tuple[int, ...], by: float):
    array = getattr(geometry, field).copy()
    array[index] += by
    if field == "axes":
        array = unit_vectors(array)
    return replace(geometry, **{field: array})


def _difference(geometry, angles_rad, field, index, step):
    plus = probe_centre(_changed(geometry, field, index, step), angles_rad)
    minus = probe_centre(_changed(geometry, field, index, -step), angles_rad)
    return (plus - minus) / (2 * step)


@settings(max_examples=25)
@given(geometries, seeds, st.booleans())
def test_every_derivative_agrees_with_central_differences(geometry, seed, is_coupled):
    last = geometry.n_joints - 1
    if is_coupled and last > 0:
        couplings = (Coupling(last, last - 1, -1.0), Coupling(0, last, 0.7))
        geometry = replace(geometry, couplings=couplings)
    angles_rad = _angles(seed, geometry)
    derivatives = probe_derivatives(geometry, angles_rad)
    tolerance = RELATIVE * size_mm(geometry)
    for k in range(geometry.n_joints):
        moved = np.zeros(geometry.n_joints)
        moved[k] = STEP
        plus = probe_centre(geometry, angles_rad + moved)
        minus = probe_centre(geometry, angles_rad - moved)
        by_angle = (plus - minus) / (2 * STEP)
        assert np.allclose(
            derivatives.by_angles[:, :, k], by_angle, rtol=0, atol=tolerance
        )
        by_zero = _difference(geometry, angles_rad, "zeros_rad", (k,), STEP)
        assert np.allclose(
            derivatives.by_zeros[:, :, k], by_zero, rtol=0, atol=tolerance
        )
        for c in range(3):
            axis = _difference(geometry, angles_rad, "axes", (k, c), STEP)
            assert np.allclose(
                derivatives.by_axes[:, :, k, c], axis, rtol=0, atol=tolerance
            )
            link = _difference(geometry, angles_rad, "links_mm", (k, c), 1.0)
            assert np.allclose(
                derivatives.by_links[:, :, k, c], link, rtol=0, atol=1e-9
            )
    for c in range(3):
        probe = _difference(geometry, angles_rad, "probe_vector_mm", (c,), 1.0)
        assert np.allclose(
            derivatives.by_probe_vector[:, :, c], probe, rtol=0, atol=1e-9
        )
        origin = _difference(geometry, angles_rad, "origin_mm", (c,), 1.0)
        assert np.allclose(derivatives.by_origin[:, :, c], origin, rtol=0, atol=1e-9)


@settings(max_examples=25)
@given(st.integers(1, 40), seeds)
def test_chunks_give_the_same_as_one_block(chunk_samples, seed):
    geometry = random_geometry(7, 5)
    angles_rad = _angles(seed, geometry, 37)
    undivided = probe_derivatives(geometry, angles_rad)
    seen = 0
    for part, chunk in derivative_chunks(geometry, angles_rad, chunk_samples):
        assert part.start == seen
        seen = part.stop
        assert np.array_equal(chunk.by_axes, undivided.by_axes[part])
        assert np.array_equal(chunk.by_angles, undivided.by_angles[part])
    assert seen == 37


def test_a_wrong_number_of_columns_is_refused():
    with pytest.raises(ValueError, match="one column a joint"):
        probe_derivatives(random_geometry(1, 3), np.zeros((4, 2)))
