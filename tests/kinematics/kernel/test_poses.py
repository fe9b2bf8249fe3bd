"""Every variant of the kernel in C against NumPy, exact decimals and itself."""

from decimal import Decimal

import numpy as np
import pytest

from tests.kinematics.arms import random_geometry, size_mm
from tests.kinematics.model.exact_arm import exact_pose
from traverse.kinematics.model.forward import numpy_pose, numpy_positions
from traverse.kinematics.model.geometry import Geometry

compiled = pytest.importorskip("traverse.kinematics.kernel.compiled")
VARIANTS = compiled.runnable_variants()
N_JOINTS = (1, 2, 3, 4, 5, 6, 7, 8, 9, 32)


@pytest.fixture(params=VARIANTS)
def variant(request):
    return request.param


def readings(geometry: Geometry, seed: int, n_samples: int, largest: float = 8.0):
    rng = np.random.default_rng(seed)
    return rng.uniform(-largest, largest, (n_samples, geometry.n_joints))


def bits(*arrays):
    """What is compared: every bit, but for those that no number has."""
    return tuple(np.where(np.isnan(a), np.nan, a).tobytes() for a in arrays)


@pytest.mark.parametrize("n_joints", N_JOINTS)
def test_agrees_with_numpy(variant, n_joints):
    geometry = random_geometry(n_joints, n_joints)
    chain = compiled.Chain(geometry, variant)
    angles = readings(geometry, 1, 150)
    centres, directions = chain.poses(angles)
    expected, shanks = numpy_pose(geometry, angles)
    # NumPy rounds the turn of each joint, up to 18 rad, before it takes the sine.
    lost = 18 * 2**-53 * n_joints
    np.testing.assert_allclose(centres, expected, rtol=0, atol=lost * size_mm(geometry))
    np.testing.assert_allclose(directions, shanks, rtol=0, atol=lost)
    positions, rotations = chain.joint_poses(angles)
    expected = numpy_positions(geometry, angles)
    np.testing.assert_allclose(
        positions, expected, rtol=0, atol=lost * size_mm(geometry)
    )
    turned = rotations[:, -1] @ geometry.probe_direction
    np.testing.assert_allclose(turned, shanks, rtol=0, atol=lost)
    assert bits(chain.centres(angles)) == bits(centres)
    assert bits(chain.positions(angles)) == bits(positions)


@pytest.mark.parametrize("n_joints", range(1, 10))
@pytest.mark.parametrize("largest_rad", [3.0, 300.0, 9.9e3, 1e7])
def test_is_within_four_units_in_the_last_place_of_the_reach(n_joints, largest_rad):
    geometry = random_geometry(50 + n_joints, n_joints)
    angles = readings(geometry, 3, 12, largest_rad)
    centres, directions = compiled.Chain(geometry, VARIANTS[-1]).poses(angles)
    unit = np.spacing(size_mm(geometry))
    for sample, centre, direction in zip(angles, centres, directions, strict=True):
        exact_centre, exact_direction = exact_pose(geometry, sample)
        for found, exact in zip(centre, exact_centre, strict=True):
            assert abs(Decimal(float(found)) - exact) <= 4 * Decimal(float(unit))
        for found, exact in zip(direction, exact_direction, strict=True):
            assert abs(Decimal(float(found)) - exact) <= Decimal(n_joints + 2) / 2**53


@pytest.mark.parametrize("turns", [0, 1, 2, 3, -5, 4096, -6300])
def test_multiples_of_a_quarter_turn_are_as_exact_as_any_angle(variant, turns):
    geometry = random_geometry(7, 3)
    near = np.nextafter(turns * np.pi / 2, np.inf)
    angles = geometry.zeros_rad + np.array([[near, -near, turns * np.pi / 2]])
    centre = compiled.Chain(geometry, variant).centres(angles)[0]
    for found, exact in zip(centre, exact_pose(geometry, angles[0])[0], strict=True):
        unit = Decimal(float(np.spacing(size_mm(geometry))))
        assert abs(Decimal(float(found)) - exact) <= 4 * unit


@pytest.mark.parametrize("n_joints", N_JOINTS)
def test_all_variants_give_the_same_bits(n_joints):
    geometry = random_geometry(n_joints, n_joints)
    angles = readings(geometry, 4, 333)
    angles[200:] *= 1e4
    angles[7, 0], angles[11, -1] = np.inf, np.nan
    found = [
        (*chain.poses(angles), *chain.joint_poses(angles), *chain.derivatives(angles))
        for chain in (compiled.Chain(geometry, name) for name in VARIANTS)
    ]
    assert {bits(*arrays) for arrays in found} == {bits(*found[0])}


@pytest.mark.parametrize("n_samples", [1, 2, 7, 8, 9, 31, 32, 33, 64, 100])
@pytest.mark.parametrize("largest_rad", [8.0, 2e4])
def test_block_and_place_in_it_leave_every_bit(variant, n_samples, largest_rad):
    geometry = random_geometry(5, 7)
    chain = compiled.Chain(geometry, variant)
    angles = readings(geometry, 6, 200, largest_rad)
    centres, directions = chain.poses(angles)
    positions, rotations = chain.joint_poses(angles)
    for first in (0, 1, 13, 100):
        part = slice(first, first + n_samples)
        block = chain.poses(angles[part])
        assert bits(*block) == bits(centres[part], directions[part])
        block = chain.joint_poses(angles[part])
        assert bits(*block) == bits(positions[part], rotations[part])


@pytest.mark.parametrize("largest_rad", [8.0, 2e4])
def test_one_pose_has_the_bits_of_the_block(variant, largest_rad):
    geometry = random_geometry(5, 7)
    chain = compiled.Chain(geometry, variant)
    angles = readings(geometry, 6, 40, largest_rad)
    for sample, centre, direction in zip(angles, *chain.poses(angles), strict=True):
        pose = (tuple(centre), tuple(direction))
        assert chain.pose(sample) == pose
        assert chain.pose(sample.tolist()) == pose
        assert chain.pose(tuple(sample)) == pose
        assert chain.pose(np.repeat(sample, 2)[::2]) == pose
        assert chain.centre(sample) == pose[0]


def test_strided_readings_are_read_and_strided_places_are_filled(variant):
    geometry = random_geometry(5, 7)
    chain = compiled.Chain(geometry, variant)
    angles = readings(geometry, 6, 90)
    expected = chain.poses(angles)
    wide = np.zeros((180, 21))
    wide[::2, ::3] = angles
    for strided in (np.asfortranarray(angles), wide[::2, ::3], angles[::-1][::-1]):
        assert bits(*chain.poses(strided)) == bits(*expected)
    assert bits(*chain.poses(angles[::-1])) == bits(*(e[::-1] for e in expected))
    into = np.zeros((90, 8))
    centres, directions = into[:, 1:4], into[:, 5:8]
    found = chain.poses(angles, centres, directions)
    assert found[0] is centres
    assert found[1] is directions
    assert bits(centres, directions) == bits(*expected)
    assert not into[:, [0, 4]].any()
    places = np.empty((90, 8, 3))
    assert chain.positions(angles, out=places) is places
    assert bits(places) == bits(chain.positions(angles))


def test_readings_that_are_no_numbers_spoil_their_sample_alone(variant):
    geometry = random_geometry(5, 4)
    chain = compiled.Chain(geometry, variant)
    angles = readings(geometry, 6, 50)
    centres, directions = chain.poses(angles)
    spoilt = angles.copy()
    spoilt[3, 0], spoilt[17, 2], spoilt[40, 3] = np.nan, np.inf, -np.inf
    rows = [3, 17, 40]
    found = chain.poses(spoilt)
    assert np.isnan(found[0][rows]).all()
    assert np.isnan(found[1][rows]).all()
    whole = np.delete(np.arange(50), rows)
    assert bits(found[0][whole], found[1][whole]) == bits(
        centres[whole], directions[whole]
    )
    # Joints before the invalid one still have values.
    positions = chain.positions(spoilt)
    assert np.isfinite(positions[17, :3]).all()
    assert np.isnan(positions[17, 3:]).all()
    assert np.isnan(chain.pose(spoilt[17])).all()


def test_base_posture_is_exact(variant):
    geometry = random_geometry(5, 6)
    centre, direction = compiled.Chain(geometry, variant).pose(geometry.zeros_rad)
    assert direction == tuple(geometry.probe_direction)
    links = [*geometry.links_mm, geometry.probe_vector_mm]
    exact = [sum(map(Decimal, map(float, c))) for c in np.transpose(links)]
    for found, link, origin in zip(centre, exact, geometry.origin_mm, strict=True):
        assert abs(Decimal(found) - link - Decimal(float(origin))) < Decimal("5e-13")


def test_empty_block_gives_empty_results(variant):
    geometry = random_geometry(1, 3)
    chain = compiled.Chain(geometry, variant)
    nothing = np.empty((0, 3))
    assert [a.shape for a in chain.poses(nothing)] == [(0, 3), (0, 3)]
    assert [a.shape for a in chain.joint_poses(nothing)] == [(0, 4, 3), (0, 3, 3, 3)]
    assert chain.derivatives(nothing)[2].shape == (0, 3, 3, 3)
