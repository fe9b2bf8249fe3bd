"""Every variant of the kernel in C against NumPy, exact decimals and itself.

The kernel's derivatives against complex steps, NumPy and exact invariances.
Refusals of the kernel in C: everything behind these checks trusts the shapes.
"""

from decimal import Decimal
from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.kinematics.arms import random_geometry, seeds, size_mm
from tests.kinematics.model.exact_arm import exact_pose
from traverse.kinematics.model.derivatives import ProbeDerivatives, numpy_derivatives
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
    """Bits to be compared: all but NaN's."""
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


@pytest.mark.parametrize("n_joints", [1, 2, 5, 7, 9])
@pytest.mark.parametrize("largest_rad", [3.0, 9.9e3, 1e7])
def test_is_within_four_units_in_the_last_place_of_the_reach(n_joints, largest_rad):
    geometry = random_geometry(50 + n_joints, n_joints)
    angles = readings(geometry, 3, 12, largest_rad)
    centres, directions = compiled.Chain(geometry, VARIANTS[-1]).poses(angles)
    unit = np.spacing(size_mm(geometry))
    for sample, centre, direction in zip(angles, centres, directions, strict=True):
        exact_centre, exact_direction = exact_pose(geometry, sample)
        for computed, exact in zip(centre, exact_centre, strict=True):
            assert abs(Decimal(float(computed)) - exact) <= 4 * Decimal(float(unit))
        for computed, exact in zip(direction, exact_direction, strict=True):
            assert (
                abs(Decimal(float(computed)) - exact) <= Decimal(n_joints + 2) / 2**53
            )


def test_multiples_of_a_quarter_turn_are_as_exact_as_any_angle(variant):
    geometry = random_geometry(7, 3)
    turns = np.array([0, 1, 2, 3, -5, 4096, -6300]) * np.pi / 2
    near = np.nextafter(turns, np.inf)
    angles = geometry.zeros_rad + np.stack([near, -near, turns], axis=1)
    unit = Decimal(float(np.spacing(size_mm(geometry))))
    centres = compiled.Chain(geometry, variant).centres(angles)
    for sample, centre in zip(angles, centres, strict=True):
        for computed, exact in zip(
            centre, exact_pose(geometry, sample)[0], strict=True
        ):
            assert abs(Decimal(float(computed)) - exact) <= 4 * unit


@pytest.mark.parametrize("n_joints", N_JOINTS)
def test_all_variants_give_the_same_bits(n_joints):
    geometry = random_geometry(n_joints, n_joints)
    angles = readings(geometry, 4, 333)
    angles[200:] *= 1e4
    angles[7, 0], angles[11, -1] = np.inf, np.nan
    by_variant = [
        (*chain.poses(angles), *chain.joint_poses(angles), *chain.derivatives(angles))
        for chain in (compiled.Chain(geometry, name) for name in VARIANTS)
    ]
    assert {bits(*arrays) for arrays in by_variant} == {bits(*by_variant[0])}


@pytest.mark.parametrize("largest_rad", [8.0, 2e4])
def test_block_and_place_in_it_leave_every_bit(variant, largest_rad):
    geometry = random_geometry(5, 7)
    chain = compiled.Chain(geometry, variant)
    angles = readings(geometry, 6, 200, largest_rad)
    centres, directions = chain.poses(angles)
    positions, rotations = chain.joint_poses(angles)
    n_samples = (1, 2, 7, 8, 9, 31, 32, 33, 64, 100)
    for first, n in product((0, 1, 13, 100), n_samples):
        part = slice(first, first + n)
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
    poses = chain.poses(angles, centres, directions)
    assert poses[0] is centres
    assert poses[1] is directions
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
    poses = chain.poses(spoilt)
    assert np.isnan(poses[0][rows]).all()
    assert np.isnan(poses[1][rows]).all()
    clean_rows = np.delete(np.arange(50), rows)
    assert bits(poses[0][clean_rows], poses[1][clean_rows]) == bits(
        centres[clean_rows], directions[clean_rows]
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
    for computed, link, origin in zip(centre, exact, geometry.origin_mm, strict=True):
        assert abs(Decimal(computed) - link - Decimal(float(origin))) < Decimal("5e-13")


def test_empty_block_gives_empty_results(variant):
    geometry = random_geometry(1, 3)
    chain = compiled.Chain(geometry, variant)
    nothing = np.empty((0, 3))
    assert [a.shape for a in chain.poses(nothing)] == [(0, 3), (0, 3)]
    assert [a.shape for a in chain.joint_poses(nothing)] == [(0, 4, 3), (0, 3, 3, 3)]
    assert chain.derivatives(nothing)[2].shape == (0, 3, 3, 3)


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
    rates = np.empty((3, *place.shape))
    for index in np.ndindex(place.shape):
        place[index] += 1j * STEP
        moved = complex_centre(values, values["angles"])
        rates[(slice(None), *index)] = moved.imag / STEP
        place[index] -= 1j * STEP
    return rates


@settings(max_examples=30)
@given(st.integers(1, 9), seeds)
def test_every_derivative_agrees_with_complex_steps(n_joints, seed):
    geometry = random_geometry(seed, n_joints)
    angles = np.random.default_rng(seed).uniform(-7, 7, (2, n_joints))
    computed = derivatives(geometry, angles)
    tolerance = 1e-14 * n_joints * size_mm(geometry)
    for n, sample in enumerate(angles):
        for name, columns, scale in (
            ("angles", computed.by_angles, tolerance),
            ("zeros_rad", computed.by_zeros, tolerance),
            ("axes", computed.by_axes, tolerance),
            ("links_mm", computed.by_links, 1e-14 * n_joints),
            ("probe_vector_mm", computed.by_probe_vector, 1e-14 * n_joints),
            ("origin_mm", computed.by_origin, 1e-14),
        ):
            expected = by_complex_step(geometry, sample, name)
            np.testing.assert_allclose(columns[n], expected, rtol=0, atol=scale)


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("n_joints", [1, 2, 5, 7, 9, 32])
def test_derivatives_agree_with_numpy(variant, n_joints):
    geometry = random_geometry(n_joints, n_joints)
    angles = np.random.default_rng(2).uniform(-7, 7, (77, n_joints))
    computed = derivatives(geometry, angles, variant)
    expected = numpy_derivatives(geometry, angles)
    for name in ("centres_mm", "by_angles", "by_axes", "by_links"):
        size = 1.0 if name == "by_links" else size_mm(geometry)
        np.testing.assert_allclose(
            getattr(computed, name),
            getattr(expected, name),
            rtol=0,
            atol=1e-14 * n_joints * size,
        )


@pytest.mark.parametrize("variant", VARIANTS)
def test_centres_and_rotations_have_the_bits_of_the_forward_kinematics(variant):
    geometry = random_geometry(3, 7)
    angles = np.random.default_rng(2).uniform(-7, 7, (77, 7))
    chain = compiled.Chain(geometry, variant)
    computed = derivatives(geometry, angles, variant)
    assert computed.centres_mm.tobytes() == chain.centres(angles).tobytes()
    rotations = chain.joint_poses(angles)[1]
    assert np.array_equal(computed.by_links.transpose(0, 2, 1, 3), rotations)


def test_block_and_place_in_it_leave_every_bit_of_derivatives(variant):
    geometry = random_geometry(3, 7)
    angles = np.random.default_rng(2).uniform(-7, 7, (77, 7))
    chain = compiled.Chain(geometry, variant)
    undivided = chain.derivatives(angles)
    for first, n in product((0, 5, 40), (1, 7, 8, 31, 33)):
        part = slice(first, first + n)
        for array, expected in zip(
            chain.derivatives(angles[part]), undivided, strict=True
        ):
            assert array.tobytes() == expected[part].tobytes()


def test_given_places_are_filled_and_returned():
    geometry = random_geometry(3, 4)
    angles = np.random.default_rng(2).uniform(-7, 7, (9, 4))
    chain = compiled.Chain(geometry, VARIANTS[-1])
    expected = chain.derivatives(angles)
    places = tuple(np.full_like(array, np.nan) for array in expected)
    assert chain.derivatives(np.asfortranarray(angles), out=places) is places
    for returned, own_place in zip(places, expected, strict=True):
        assert np.array_equal(returned, own_place)


GEOMETRY = random_geometry(1, 3)
CHAIN = compiled.Chain(GEOMETRY, compiled.runnable_variants()[-1])
ANGLES = np.zeros((5, 3))


@pytest.mark.parametrize(
    "of",
    [CHAIN.poses, CHAIN.centres, CHAIN.positions, CHAIN.joint_poses, CHAIN.derivatives],
)
def test_readings_of_another_shape_are_refused(of):
    for shape in [(3,), (2, 2), (2, 4), (1, 2, 3)]:
        message = rf"angles_rad has shape .*expected \({shape[0]}, 3\)"
        with pytest.raises(ValueError, match=message):
            of(np.zeros(shape))


@pytest.mark.parametrize("shape", [(4, 3), (15,)])
def test_arrays_that_lie_about_their_shape_are_refused(shape):
    class Lying(np.ndarray):
        shape = (5, 3)

    with pytest.raises(ValueError, match=r"dimensions|memory of another shape"):
        CHAIN.centres(ANGLES, out=np.zeros(shape).view(Lying))


@pytest.mark.parametrize("dtype", [np.int64, np.float32, ">f8"])
def test_readings_of_another_kind_are_refused(dtype):
    with pytest.raises(ValueError, match="expected aligned float64"):
        CHAIN.poses(ANGLES.astype(dtype))


def test_unaligned_readings_are_refused():
    memory = np.zeros(ANGLES.nbytes + 4, np.uint8)
    unaligned = memory[4:].view(np.float64).reshape(5, 3)
    aligned_at = memory.ctypes.data % 8
    with pytest.raises(ValueError, match="expected aligned float64"):
        CHAIN.poses(unaligned if aligned_at == 0 else memory[:-4].view(float))


def test_places_of_another_shape_or_read_only_are_refused():
    with pytest.raises(ValueError, match=r"directions has shape \(4, 3\)"):
        CHAIN.poses(ANGLES, None, np.zeros((4, 3)))
    with pytest.raises(ValueError, match="read-only"):
        CHAIN.centres(ANGLES, out=np.broadcast_to(np.zeros(3), (5, 3)))
    with pytest.raises(ValueError, match="not C-contiguous"):
        CHAIN.positions(ANGLES, out=np.zeros((5, 3, 4)).transpose(0, 2, 1))
    places = CHAIN.derivatives(ANGLES)
    with pytest.raises(ValueError, match="by_axes has shape"):
        CHAIN.derivatives(ANGLES, out=(*places[:2], places[2][:, :, :2], places[3]))


@pytest.mark.parametrize(
    "sample", [[0.0] * 2, [0.0] * 4, (0.0,) * 4, np.zeros(4), np.zeros((1, 3))]
)
def test_one_sample_of_another_length_is_refused(sample):
    with pytest.raises(ValueError, match="expected 3 floats"):
        CHAIN.pose(sample)


def test_one_sample_of_words_is_refused():
    with pytest.raises(TypeError):
        CHAIN.pose(["a", "b", "c"])
    with pytest.raises(TypeError):
        CHAIN.pose(7.0)


def test_list_that_shrinks_while_it_is_read_is_refused():
    class Shrinking:
        def __float__(self):
            del sample[1:]
            return 0.0

    sample = [Shrinking(), 0.0, 0.0]
    with pytest.raises(ValueError, match="expected 3 floats"):
        CHAIN.pose(sample)


def test_arm_of_too_many_joints_and_unknown_variants_are_refused():
    with pytest.raises(ValueError, match="33 joints, expected at most 32"):
        compiled.Chain(random_geometry(1, 33), "portable")
    with pytest.raises(ValueError, match="'avx1024' does not run on this processor"):
        compiled.Chain(GEOMETRY, "avx1024")
