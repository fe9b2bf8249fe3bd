"""A campaign that says everything, fitted, for the tests of the banks."""

from dataclasses import dataclass, replace

import numpy as np

from tests.lab.simulated import (
    TrueArm,
    arm_value,
    bar,
    cones,
    disturbed,
    seven_joints,
    simulate,
)
from tests.shared import shared
from traverse.kinematics.arm_file.arm import Arm, Effect
from traverse.kinematics.effects.arm_effects import effects_of
from traverse.kinematics.effects.pose import corrected_pose
from traverse.kinematics.model.derivatives import probe_derivatives
from traverse.lab.campaign.campaign import Campaign
from traverse.lab.diagnosis.model.fit import Fit, fitted
from traverse.lab.diagnosis.model.observation_equations import (
    ObservationEquations,
    decorrelated_equations,
    equations_of,
)

MASSES_KG = (3.0, 2.5, 2.0, 1.2, 0.8, 0.5, 0.3)
N_EACH = 40


@dataclass(frozen=True)
class Measurement:
    """A campaign of an arm of seven joints and what it was made of."""

    arm: Arm
    truth: TrueArm
    campaign: Campaign

    def fit(self, effects: tuple[Effect, ...] = ()) -> Fit:
        arm = self.arm.model_copy(update={"effects": effects})
        eligible = np.ones(len(self.campaign.poses), dtype=np.bool_)
        return fitted(self.campaign, arm, eligible)

    def rows(self) -> ObservationEquations:
        return equations_of(self.fit().adjustment)

    def with_poses(self, **columns) -> "Measurement":
        return replace(self, campaign=self.campaign.with_poses(**columns))

    def with_effect(self, effect: Effect) -> "Measurement":
        """The same touches by an arm that has an effect: other readings."""
        geometry, poses = self.truth.geometry(), self.campaign.poses
        effects = effects_of(self.arm, (effect,), self.campaign.span)
        touched_mm = self.truth.centres(poses.angles_rad)
        angles_rad = poses.angles_rad
        for _ in range(4):
            block = self.campaign.block(poses, angles_rad)
            away_mm = touched_mm - corrected_pose(geometry, effects, block)[0]
            slopes = probe_derivatives(geometry, angles_rad).by_angles
            steps = np.linalg.pinv(slopes) @ away_mm[:, :, np.newaxis]
            angles_rad = angles_rad + steps[:, :, 0]
        return self.with_poses(angles_rad=angles_rad)


@shared
def measured(seed: int = 3) -> Measurement:
    """Four cones, a sphere and a bar, the poses in an order that mixes them."""
    truth = disturbed(seven_joints(), seed)
    tables = [*cones(4), {"id": "ball", "kind": "sphere", "radius_mm": 25.4}, bar()]
    campaign = simulate(truth, tables, N_EACH, seed)
    rng = np.random.default_rng(seed)
    n = len(campaign.poses)
    times_s = 4.0 * np.arange(n) + rng.uniform(0.0, 2.0, n)
    warmth_c = 20.0 + 3.0 * np.sin(2.0 * np.pi * times_s / times_s[-1])
    directions = rng.normal(size=(n, 3))
    poses = replace(
        campaign.poses.part(rng.permutation(n)),
        time_s=times_s,
        temperature_c=warmth_c,
        joint_temperatures_c=warmth_c[:, None] + rng.normal(size=(n, 7)),
        approaches=rng.choice([-1.0, 1.0], size=(n, 7)),
        speeds_rad_s=0.3 * rng.normal(size=(n, 7)),
        directions=directions / np.linalg.norm(directions, axis=1, keepdims=True),
        force_n=rng.lognormal(-0.7, 0.3, n),
    )
    arm = arm_with_masses(seven_joints())
    return Measurement(arm, truth, replace(campaign, poses=poses))


@shared
def measured_rows() -> ObservationEquations:
    return measured().rows()


@shared
def serial_rows() -> ObservationEquations:
    """The same with noise that is correlated from row to row."""
    rows = measured_rows()
    lags = np.subtract.outer(np.arange(len(rows.values)), np.arange(len(rows.values)))
    correlation = 0.6 * np.eye(len(lags)) + 0.4 * 0.9 ** np.abs(lags)
    return decorrelated_equations(rows, np.linalg.cholesky(correlation))


def arm_with_masses(arm: TrueArm) -> Arm:
    value = arm_value(arm)
    joints = tuple(
        joint.model_copy(update={"mass_kg": mass})
        for joint, mass in zip(value.joints, MASSES_KG, strict=True)
    )
    return value.model_copy(update={"joints": joints})
