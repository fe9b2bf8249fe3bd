"""The arm before anything yields: where its parts are and what they weigh there."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.arm_file.arm import Arm
from traverse.simulator.arm.physics import Mechanism, body_motions
from traverse.simulator.effects.surroundings import Surroundings

M_PER_MM = 1e-3


@dataclass(frozen=True, slots=True)
class Build:
    """The true arm with its masses, in the base posture.

    Attributes:
        mechanism: Geometry.
        zeros_rad: (n_joints,) readings in the base posture.
        links_mm: (n_joints, 3) from each joint's origin to the next one's.
        masses_kg: (n_joints + 1,) of the elements and, last, of the probe; 0 where
            the arm file states none.
        centres_mm: (n_joints + 1, 3) where those masses are; the probe's at the ball.
        gravity_m_s2: (3,)
    """

    mechanism: Mechanism
    zeros_rad: Floats
    links_mm: Floats
    masses_kg: Floats
    centres_mm: Floats
    gravity_m_s2: Floats


def build_of(arm: Arm, mechanism: Mechanism, zeros_rad: Floats) -> Build:
    """Hang the masses of an arm file on the true geometry."""
    origins_mm = mechanism.origins_mm
    end_mm = mechanism.probe_mm - np.array(arm.probe.vector_mm)
    links_mm = np.diff(np.vstack([origins_mm, end_mm]), axis=0)
    centres_mm = np.vstack([origins_mm + 0.5 * links_mm, mechanism.probe_mm])
    for k, joint in enumerate(arm.joints):
        if joint.centre_of_mass_mm is not None:
            centres_mm[k] = origins_mm[k] + np.array(joint.centre_of_mass_mm)
    masses = [*(joint.mass_kg for joint in arm.joints), arm.probe.mass_kg]
    return Build(
        mechanism=mechanism,
        zeros_rad=zeros_rad,
        links_mm=links_mm,
        masses_kg=np.array([mass or 0.0 for mass in masses]),
        centres_mm=centres_mm,
        gravity_m_s2=np.array(arm.reference.gravity_m_s2, dtype=np.float64),
    )


@dataclass(frozen=True)
class Posture:
    """The rigid arm at some turns; values are computed once.

    Attributes:
        build: The arm.
        turns_rad: (n, n_joints) from the base posture.
        around: Of every sample.
    """

    build: Build
    turns_rad: Floats
    around: Surroundings

    @cached_property
    def motions(self) -> Floats:
        """Of all bodies from the base posture, (n, n_joints + 1, 4, 4)."""
        return body_motions(self.build.mechanism, self.turns_rad)

    @cached_property
    def moments_nm(self) -> Floats:
        """Of all weights beyond each joint about its origin, (n, n_joints, 3).

        Every mass pulls at where it is now, (p - o) x m g.
        """
        n_joints = self.build.mechanism.n_joints
        carriers = [*range(1, n_joints + 1), n_joints]  # the last one has the probe
        places_mm = moved_points(self.motions[:, carriers], self.build.centres_mm)
        origins_mm = moved_points(self.motions[:, :-1], self.build.mechanism.origins_mm)
        weighted = self.build.masses_kg[:, None] * places_mm
        beyond = np.cumsum(weighted[:, ::-1], axis=1)[:, ::-1]
        masses_kg = np.cumsum(self.build.masses_kg[::-1])[::-1]
        lever_kg_mm = beyond[:, :-1] - masses_kg[:-1, None] * origins_mm
        moments: Floats = M_PER_MM * np.cross(lever_kg_mm, self.build.gravity_m_s2)
        return moments

    def axis(self, joint: int) -> Floats:
        """Where the axis of a joint points, (n, 3)."""
        pointing: Floats = (
            self.motions[:, joint, :3, :3] @ self.build.mechanism.axes[joint]
        )
        return pointing

    def in_carrier(self, vectors: Floats, joint: int) -> Floats:
        """Vectors (n, 3) as the body that carries the joint had them at first."""
        turned = self.motions[:, joint, :3, :3]
        brought: Floats = np.einsum("mij,mi->mj", turned, vectors)
        return brought


def moved_points(motions: Floats, points_mm: Floats) -> Floats:
    """Points (m, 3) each moved by its own motion (n, m, 4, 4): (n, m, 3)."""
    turned = (motions[..., :3, :3] @ points_mm[:, :, None])[..., 0]
    moved: Floats = turned + motions[..., :3, 3]
    return moved
