"""The kernel's derivatives against complex steps, NumPy and exact invariances."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.kinematics.arms import random_geometry, seeds, size_mm
from traverse.kinematics.model.derivatives import ProbeDerivatives, numpy_derivatives

compiled = pytest.importorskip("traverse.kinematics.kernel.compiled")
VARIANTS = compiled.runnable_variants()
STEP = 1e-20


def derivatives(geometry, angles, variant=VARIANTS[-1]):
    return ProbeDerivatives(*compiled.Chain(geometry, variant).derivatives(angles))


def complex_centre(values, angles):
    """The centre of one sample, of complex parameters; axes are normalised here."""
    v = values["probe_vector_mm"]
    for k in reversed(range(len(angles))):
        u = values["axes"][k]
        u = u / np.sqrt(np.sum(u * u))
        w = v + values["links_mm"][k]
        theta = angles[k] - values["zeros_rad"][k]
        v = w * np.cos(theta) + np.cross(u, w) * np.sin(theta)
        v = v + u * np.sum(u * w) * (1 - np.cos(theta))
    return v + values["origin_mm"]


def by_complex_step(geometry, angles, name):
    """Differentiate one sample by every component of one kind of parameter."""
    names = ("probe_vector_mm", "axes", "links_mm", "zeros_rad", "origin_mm")
    values = {n: getattr(geometry, n).astype(complex) for n in names}
    values["angles"] = angles.astype(complex)
    place = values[name]
    found = np.empty((3, *place.shape))
    for index in np.ndindex(place.shape):
        place[index] += 1j * STEP
        moved = complex_centre(values, values["angles"])
        found[(slice(None), *index)] = moved.imag / STEP
        place[index] -= 1j * STEP
    return found


@settings(max_examples=30)
@given(st.integers(1, 9), seeds)
def test_every_derivative_agrees_with_complex_steps(n_joints, seed):
    geometry = random_geometry(seed, n_joints)
    angles = np.random.default_rng(seed).uniform(-7, 7, (2, n_joints))
    found = derivatives(geometry, angles)
    tolerance = 1e-14 * n_joints * size_mm(geometry)
    for n, sample in enumerate(angles):
        for name, columns, scale in (
            ("angles", found.by_angles, tolerance),
            ("zeros_rad", found.by_zeros, tolerance),
            ("axes", found.by_axes, tolerance),
            ("links_mm", found.by_links, 1e-14 * n_joints),
            ("probe_vector_mm", found.by_probe_vector, 1e-14 * n_joints),
            ("origin_mm", found.by_origin, 1e-14),
        ):
            expected = by_complex_step(geometry, sample, name)
            np.testing.assert_allclose(columns[n], expected, rtol=0, atol=scale)


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("n_joints", [1, 2, 5, 7, 9, 32])
def test_agrees_with_numpy(variant, n_joints):
    geometry = random_geometry(n_joints, n_joints)
    angles = np.random.default_rng(2).uniform(-7, 7, (77, n_joints))
    found = derivatives(geometry, angles, variant)
    expected = numpy_derivatives(geometry, angles)
    for name in ("centres_mm", "by_angles", "by_axes", "by_links"):
        size = 1.0 if name == "by_links" else size_mm(geometry)
        np.testing.assert_allclose(
            getattr(found, name),
            getattr(expected, name),
            rtol=0,
            atol=1e-14 * n_joints * size,
        )


@pytest.mark.parametrize("variant", VARIANTS)
def test_centres_and_rotations_have_the_bits_of_the_forward_kinematics(variant):
    geometry = random_geometry(3, 7)
    angles = np.random.default_rng(2).uniform(-7, 7, (77, 7))
    chain = compiled.Chain(geometry, variant)
    found = derivatives(geometry, angles, variant)
    assert found.centres_mm.tobytes() == chain.centres(angles).tobytes()
    rotations = chain.joint_poses(angles)[1]
    assert np.array_equal(found.by_links.transpose(0, 2, 1, 3), rotations)


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("n_samples", [1, 7, 8, 31, 33])
def test_block_and_place_in_it_leave_every_bit(variant, n_samples):
    geometry = random_geometry(3, 7)
    angles = np.random.default_rng(2).uniform(-7, 7, (77, 7))
    chain = compiled.Chain(geometry, variant)
    whole = chain.derivatives(angles)
    for first in (0, 5, 40):
        part = slice(first, first + n_samples)
        for found, expected in zip(chain.derivatives(angles[part]), whole, strict=True):
            assert found.tobytes() == expected[part].tobytes()


def test_given_places_are_filled_and_returned():
    geometry = random_geometry(3, 4)
    angles = np.random.default_rng(2).uniform(-7, 7, (9, 4))
    chain = compiled.Chain(geometry, VARIANTS[-1])
    expected = chain.derivatives(angles)
    places = tuple(np.full_like(array, np.nan) for array in expected)
    assert chain.derivatives(np.asfortranarray(angles), out=places) is places
    for found, wanted in zip(places, expected, strict=True):
        assert np.array_equal(found, wanted)
