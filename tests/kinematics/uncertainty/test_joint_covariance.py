"""Lengths between points of one arm, against thousands of arms.

Each trial draws one arm for all its points, as a session has it, and noise of its own
for every point; places are computed by the independent arm of the neighbouring module.
"""

import numpy as np
import pytest

from tests.kinematics.uncertainty.test_point_covariance import (
    arm,
    centres_mm,
    effects,
    geometry,
    postures,
    stated_values,
)
from traverse.kinematics.effects.base.block import Block
from traverse.kinematics.uncertainty.arm_covariance import (
    ArmCovariance,
    parameter_columns,
)
from traverse.kinematics.uncertainty.joint_covariance import JointCovariance
from traverse.kinematics.uncertainty.point_covariance import (
    PointNoise,
    point_uncertainties,
)

__all__ = ["arm", "effects", "geometry"]  # fixtures

N = 2000
# 95.45 % of 2000 draws lie within k = 2: one in 10,000 times outside of these parts.
LEAST, MOST = 0.9363, 0.9728
CONTACT_MM, ENCODER_RAD = 0.004, 1e-5


class Bench:
    """An arm known within a covariance, with noise of readings and contacts."""

    def __init__(self, geometry, effects):
        rng = np.random.default_rng(3)
        self.geometry, self.effects = geometry, effects
        self.values = stated_values(geometry, effects)
        n_joints, n = geometry.n_joints, len(self.values)
        sizes = np.full(n, 0.01)
        sizes[: 3 * n_joints] = 2e-5  # axes are unit vectors
        sizes[-5:-3] = 1e-6
        # Correlated, as identified parameters are, and of lower rank.
        mixed = rng.normal(size=(n, n // 2)) / np.sqrt(n // 2)
        self.arm = ArmCovariance(sizes[:, None] * mixed)
        self.noise = PointNoise(
            np.full(n_joints, ENCODER_RAD), np.zeros(n_joints), CONTACT_MM, 0.0
        )

    def stated(self, angles_rad) -> JointCovariance:
        block = Block(angles_rad)
        uncertainties = point_uncertainties(
            self.geometry, self.effects, block, self.noise, self.arm
        )
        places_mm = self.measured(angles_rad, None)
        return JointCovariance(
            places_mm, uncertainties.covariances_mm2, uncertainties.shared_mm
        )

    def measured(self, angles_rad, rng):
        """Where an arm of this kind finds the points; without chance the stated one."""
        return self.drawn(angles_rad, rng, 1)[0]

    def drawn(self, angles_rad, rng, n_draws=N):
        """Places that so many arms of this kind find, (n_draws, n, 3)."""
        n, _n_joints = angles_rad.shape
        values = np.tile(self.values, (n_draws, 1))
        noise_mm, read_rad = 0.0, np.tile(angles_rad, (n_draws, 1))
        if rng is not None:
            factor = self.arm.factor
            values += rng.normal(size=(n_draws, factor.shape[1])) @ factor.T
            read_rad += ENCODER_RAD * rng.normal(size=read_rad.shape)
            noise_mm = CONTACT_MM * rng.normal(size=(n_draws, n, 3))
        parameters = np.repeat(values, n, axis=0)
        places_mm = centres_mm(self.geometry, self.effects, read_rad, parameters)
        return places_mm.reshape(n_draws, n, 3) + noise_mm


@pytest.fixture(scope="module")
def bench(geometry, effects):
    return Bench(geometry, effects)


def near(angles_rad, distance_mm, bench, seed):
    """A posture whose ball is about so far away."""
    rng = np.random.default_rng(seed)
    other = angles_rad + 1e-4 * rng.normal(size=angles_rad.shape)
    moved = np.linalg.norm(
        np.diff(bench.measured(np.stack([angles_rad, other]), None), axis=0)
    )
    return angles_rad + (other - angles_rad) * distance_mm / moved


def pair(kind, bench):
    first, second = postures(bench.geometry, 2, 5)
    if kind == "near":
        second = near(first, 1.0, bench, 6)
    elif kind == "middle":
        second = near(first, 30.0, bench, 6)
    elif kind == "turned":  # the same posture about the first joint
        second = first.copy()
        second[0] += 2.0
    elif kind == "elbow":  # the same place nearly, other joints
        second = first.copy()
        second[-3:] += 1.5
    return np.stack([first, second])


@pytest.mark.parametrize("kind", ["far", "middle", "near", "turned", "elbow"])
def test_95_of_100_lengths_lie_within_their_uncertainty(bench, kind):
    angles_rad = pair(kind, bench)
    stated = bench.stated(angles_rad).length(0, 1)
    rng = np.random.default_rng(8)
    found_mm = np.linalg.norm(np.diff(bench.drawn(angles_rad, rng), axis=1), axis=2)
    inside = np.mean(np.abs(found_mm - stated.length_mm) <= stated.expanded_mm)
    assert LEAST < inside < MOST
    assert stated.with_arm


def test_what_points_share_does_not_lengthen_what_is_between_them(bench):
    """Neighbours are off together: a short length is better than its ends."""
    short = bench.stated(pair("near", bench))
    apart = JointCovariance(
        short.points_mm, short.covariances_mm2, np.zeros_like(short.shared_mm)
    )
    assert short.length(0, 1).std_mm < 0.5 * apart.length(0, 1).std_mm


def test_blocks_are_those_of_the_points_and_of_their_differences(bench):
    angles_rad = postures(bench.geometry, 3, 12)
    stated = bench.stated(angles_rad)
    alone_cov = point_uncertainties(
        bench.geometry, bench.effects, Block(angles_rad), bench.noise, bench.arm
    ).covariances_mm2
    columns, _ = parameter_columns(bench.geometry, bench.effects, Block(angles_rad))
    known = bench.arm.covariance
    for i in range(3):
        for j in range(3):
            block = stated.covariance_mm2[3 * i : 3 * i + 3, 3 * j : 3 * j + 3]
            expected = alone_cov[i] if i == j else columns[i] @ known @ columns[j].T
            np.testing.assert_allclose(block, expected, atol=1e-15)
    np.testing.assert_allclose(stated.covariance_mm2, stated.covariance_mm2.T)


def test_without_an_arm_it_is_said_and_one_place_is_no_length(bench):
    angles_rad = postures(bench.geometry, 2, 12)
    uncertainties = point_uncertainties(
        bench.geometry, bench.effects, Block(angles_rad), bench.noise
    )
    places_mm = bench.measured(angles_rad, None)
    joint = JointCovariance(
        places_mm, uncertainties.covariances_mm2, uncertainties.shared_mm
    )
    assert not joint.length(0, 1).with_arm
    assert joint.length(0, 1).length_mm == pytest.approx(
        np.linalg.norm(np.diff(places_mm, axis=0))
    )
    with pytest.raises(ValueError, match="same place"):
        joint.length(1, 1)
