"""The stated covariance of a point against thousands of arms, noises and instants."""

import hashlib

import numpy as np
import pytest

from tests.arm_files import arm_text, joint_text
from tests.kinematics.arms import random_geometry
from traverse.kinematics.arm_file.arm import parse_arm
from traverse.kinematics.effects.arm_effects import ArmEffects, effects_from_arm
from traverse.kinematics.effects.base.block import Block
from traverse.kinematics.effects.pose import corrected_pose
from traverse.kinematics.model.geometry import Geometry, geometry_from_arm
from traverse.kinematics.uncertainty.arm_covariance import (
    ArmCovariance,
    parameter_columns,
    parameter_names,
    read_arm_covariance,
)
from traverse.kinematics.uncertainty.point_covariance import (
    PointNoise,
    point_uncertainties,
    reading_variances,
)

CHI2_95_OF_3 = 7.814727903251179  # published quantile
N = 4000


@pytest.fixture(scope="module")
def arm():
    drawn = random_geometry(11, 7)
    rows = zip(drawn.axes, drawn.links_mm, drawn.zeros_rad / 5, strict=True)
    joints = (
        joint_text(f"J{number}", axis.tolist(), link_mm.tolist(), zero_rad)
        for number, (axis, link_mm, zero_rad) in enumerate(rows, start=1)
    )
    text = arm_text(
        *("seven", *joints),
        origin_mm=[3, -4, 5],
        probe='radius_mm = 3.0\nkind = "hard"\nvector_mm = [10, 0, 20]',
    )
    eccentric = '[[effects]]\nkind = "encoder_eccentricity"\njoint = "J2"\n'
    return parse_arm(f"{text}{eccentric}cos_rad = 3e-5\nsin_rad = -2e-5\n")


@pytest.fixture(scope="module")
def geometry(arm) -> Geometry:
    return geometry_from_arm(arm)


@pytest.fixture(scope="module")
def effects(arm) -> ArmEffects:
    return effects_from_arm(arm)


def turned(vectors, axes, angles_rad):
    """Rodrigues' formula for many at a time: vectors and axes (n, 3), angles (n,)."""
    cosine, sine = np.cos(angles_rad)[:, None], np.sin(angles_rad)[:, None]
    along = np.sum(axes * vectors, axis=1, keepdims=True)
    return (
        cosine * vectors + sine * np.cross(axes, vectors) + (1 - cosine) * along * axes
    )


def centres_mm(geometry, effects, angles_rad, parameters):
    """Where the balls are, from parameters (n, n_parameters) in their stated order."""
    n, n_joints = angles_rad.shape
    axes = parameters[:, : 3 * n_joints].reshape(n, n_joints, 3)
    axes = axes / np.linalg.norm(axes, axis=2, keepdims=True)
    links = parameters[:, 3 * n_joints : 6 * n_joints].reshape(n, n_joints, 3)
    start = 6 * n_joints
    vectors, amplitudes = (
        parameters[:, start : start + 3],
        parameters[:, start + 3 : -3],
    )
    corrected = angles_rad.copy()
    cosine, sine = amplitudes.T
    second = angles_rad[:, 1]
    corrected[:, 1] -= cosine * np.cos(second) + sine * np.sin(second)
    x = links[:, -1] + vectors
    for k in reversed(range(n_joints)):
        x = turned(x, axes[:, k], corrected[:, k] - geometry.zeros_rad[k])
        if k:
            x = x + links[:, k - 1]
    return parameters[:, -3:] + x


def stated_values(geometry, effects):
    return np.concatenate(
        [
            geometry.axes.ravel(),
            geometry.links_mm.ravel(),
            geometry.probe_vector_mm,
            effects.values,
            geometry.origin_mm,
        ]
    )


def postures(geometry, n, seed):
    rng = np.random.default_rng(seed)
    return geometry.zeros_rad + rng.uniform(-2.5, 2.5, (n, geometry.n_joints))


def test_columns_are_the_differences_of_an_independent_arm(geometry, effects):
    angles_rad = postures(geometry, 4, 1)
    values = stated_values(geometry, effects)
    derivatives, _ = parameter_columns(geometry, effects, Block(angles_rad))
    assert derivatives.shape == (4, 3, len(values))
    start, _, _ = corrected_pose(geometry, effects, Block(angles_rad))
    nominal = np.tile(values, (4, 1))
    np.testing.assert_allclose(
        centres_mm(geometry, effects, angles_rad, nominal), start, atol=1e-9
    )
    for number in range(len(values)):
        step = 1e-5
        up, down = nominal.copy(), nominal.copy()
        up[:, number] += step
        down[:, number] -= step
        slope = (
            centres_mm(geometry, effects, angles_rad, up)
            - centres_mm(geometry, effects, angles_rad, down)
        ) / (2 * step)
        np.testing.assert_allclose(derivatives[:, :, number], slope, atol=2e-4)


@pytest.mark.parametrize("samples", [1, 25])
@pytest.mark.parametrize("moving", [False, True])
def test_95_of_100_points_lie_in_their_ellipsoids(geometry, effects, samples, moving):
    rng = np.random.default_rng([samples, moving])
    n_joints = geometry.n_joints
    noise = PointNoise(
        rng.uniform(3e-6, 3e-5, n_joints),
        2
        * np.pi
        / np.array([2**17, 2**19, 2**20, 2**17, 2**18, 2**18, 2**17])[:n_joints],
        contact_mm=0.004,
        instant_s=2e-5,
    )
    values = stated_values(geometry, effects)
    scales = np.concatenate(
        [
            np.full(3 * n_joints, 1e-5),
            np.full(3 * n_joints + 3, 0.01),
            np.full(2, 4e-6),
            np.full(3, 0.005),
        ]
    )
    known = ArmCovariance(scales[:, None] * rng.normal(size=(len(values), 20)) / 4.0)
    angles_rad = postures(geometry, N, 5)
    speeds = rng.normal(size=angles_rad.shape) * 0.5 if moving else None

    # What happens: an arm that is a little different, an instant a little later,
    # encoders with noise that round, a contact. Samples follow one another at rest.
    parameters = values + rng.normal(size=(N, 20)) @ known.factor.T
    there_rad = angles_rad.copy()
    if speeds is not None:
        there_rad += noise.instant_s * rng.normal(size=(N, 1)) * speeds
    truth_mm = centres_mm(geometry, effects, there_rad, parameters)
    truth_mm += noise.contact_mm * rng.normal(size=(N, 3))
    shape = (samples, *angles_rad.shape)
    seen = angles_rad + noise.encoder_rad * rng.normal(size=shape)
    mean_rad = np.mean(noise.step_rad * np.rint(seen / noise.step_rad), axis=0)

    block = Block(mean_rad)
    measured_mm, _, _ = corrected_pose(geometry, effects, block)
    stated = point_uncertainties(
        geometry, effects, block, noise, known, speeds_rad_s=speeds, samples=samples
    ).covariances_mm2
    away_mm = measured_mm - truth_mm
    normalised = np.einsum(
        "ni,ni->n", away_mm, np.linalg.solve(stated, away_mm[..., None])[..., 0]
    )
    inside = float(np.mean(normalised < CHI2_95_OF_3))
    assert 0.93 < inside < 0.97
    # And not by luck of one quantile: the mean of chi-square with 3 degrees is 3.
    assert abs(normalised.mean() - 3.0) < 0.25


def test_parts_add_up_and_only_noise_becomes_less_with_more_samples(geometry, effects):
    block = Block(postures(geometry, 3, 7))
    n = geometry.n_joints
    fine, coarse = np.full(n, 1e-9), np.full(n, 1e-3)
    noise = PointNoise(np.full(n, 1e-5), fine, 0.0, 0.0)
    single = point_uncertainties(geometry, effects, block, noise).covariances_mm2
    many = point_uncertainties(
        geometry, effects, block, noise, samples=100
    ).covariances_mm2
    np.testing.assert_allclose(many, single / 100, rtol=1e-4)
    np.testing.assert_array_equal(single, single.transpose(0, 2, 1))
    steps = PointNoise(np.full(n, 1e-5), coarse, 0.0, 0.0)
    rounded = point_uncertainties(
        geometry, effects, block, steps, samples=100
    ).covariances_mm2
    # Of the rounding error of 1e-3 / sqrt(12) hardly anything becomes less.
    assert np.all(np.einsum("nii->n", rounded) > 100 * np.einsum("nii->n", many))
    contact = PointNoise(np.zeros(n), np.zeros(n), 0.02, 1e-3)
    np.testing.assert_allclose(
        point_uncertainties(
            geometry, effects, block, contact, samples=9
        ).covariances_mm2,
        np.tile(4e-4 * np.eye(3), (3, 1, 1)),
        atol=1e-18,
    )


@pytest.mark.parametrize("ratio", [0.0, 0.05, 0.15, 0.3, 0.6])
def test_mean_of_rounded_samples_varies_as_stated(ratio):
    rng = np.random.default_rng(8)
    step, samples = 1e-4, 20
    places = step * rng.uniform(size=(20_000, 1))
    noisy = places + ratio * step * rng.normal(size=(20_000, samples))
    errors = np.mean(step * np.rint(noisy / step), axis=1) - places[:, 0]
    noise = PointNoise(np.array([ratio * step]), np.array([step]), 0.0, 0.0)
    (stated,) = reading_variances(noise, samples)
    assert np.mean(errors**2) == pytest.approx(stated, rel=0.03)


class TestFile:
    @pytest.fixture
    def names(self, arm, effects):
        return parameter_names([j.name for j in arm.joints], effects.parameter_names)

    def write(self, path, names, covariance):
        np.savez(path, names=np.array(names), covariance=covariance)
        return hashlib.sha256(path.read_bytes()).hexdigest()

    def test_a_file_is_restored_whatever_its_order(self, tmp_path, names):
        rng = np.random.default_rng(3)
        factor = rng.normal(size=(12, 5)) * np.logspace(-6, 1, 12)[:, None]
        chosen = rng.permutation(len(names))[:12]
        path = tmp_path / "arm.cov.npz"
        digest = self.write(path, [names[i] for i in chosen], factor @ factor.T)
        for stated in (digest, f"sha256:{digest}", None):
            covariance = read_arm_covariance(path, names, stated).covariance
            expected = np.zeros((len(names), len(names)))
            expected[np.ix_(chosen, chosen)] = factor @ factor.T
            np.testing.assert_allclose(covariance, expected, rtol=1e-6, atol=1e-18)

    @pytest.mark.parametrize(
        ("spoil", "reason"),
        [
            (lambda p, n: p.unlink(), "remove covariance_file"),
            (lambda p, n: p.write_bytes(b"no zip"), "no covariance of an arm"),
            (lambda p, n: p.write_bytes(p.read_bytes()[:-30]), "no covariance"),
            (lambda p, n: np.savez(p, covariance=np.eye(2)), "no covariance"),
            (
                lambda p, n: np.savez(p, names=["J9.axis.x"], covariance=np.eye(1)),
                "J9.axis.x",
            ),
            (
                lambda p, n: np.savez(p, names=n[:2], covariance=np.eye(3)),
                r"shape \(3, 3\)",
            ),
            (
                lambda p, n: np.savez(p, names=n[:1], covariance=[[np.nan]]),
                "not finite",
            ),
            (
                lambda p, n: np.savez(p, names=n[:2], covariance=[[1, 2], [2, 1]]),
                "smallest eigenvalue -1",
            ),
            (
                lambda p, n: np.savez(p, names=[n[0]] * 2, covariance=np.eye(2)),
                "occurs twice",
            ),
        ],
    )
    def test_a_wrong_file_is_refused_with_its_reason(
        self, tmp_path, names, spoil, reason
    ):
        path = tmp_path / "arm.cov.npz"
        self.write(path, names[:3], np.eye(3))
        spoil(path, list(names))
        with pytest.raises(ValueError, match=reason) as refusal:
            read_arm_covariance(path, names, None)
        assert str(path) in str(refusal.value)

    def test_a_file_of_another_identification_is_refused(self, tmp_path, names):
        path = tmp_path / "arm.cov.npz"
        self.write(path, names[:3], np.eye(3))
        with pytest.raises(ValueError, match="same identification"):
            read_arm_covariance(path, names, "0" * 64)
