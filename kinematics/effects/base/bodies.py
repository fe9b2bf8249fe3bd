"""The masses of an arm, and the moments of their weight about its joints."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from traverse.arrays import Booleans, Floats
from traverse.kinematics.model.geometry import Geometry
from traverse.kinematics.model.quaternion import cross, rotate

if TYPE_CHECKING:
    from traverse.kinematics.arm_file.arm import Arm


M_PER_MM = 1e-3


@dataclass(frozen=True, slots=True, eq=False)
class Bodies:
    """Bodies with mass.

    Attributes:
        masses_kg: of the element that each joint carries, NaN if unknown, (n_joints,).
        centres_mm: of those masses, from the joint's origin in the base posture; NaN
            for the middle of the element, (n_joints, 3).
        probe_mass_kg: at the ball's centre; NaN if unknown.
    """

    masses_kg: Floats
    centres_mm: Floats
    probe_mass_kg: float

    @property
    def are_known(self) -> Booleans:
        """Whether each element's mass is known, or the probe's, (n_joints,)."""
        known = np.isfinite(self.masses_kg)
        known[-1] |= np.isfinite(self.probe_mass_kg)
        return known

    def levers_kg_mm(self, geometry: Geometry) -> Floats:
        """Return contributions of each element to the mass moment, in the base posture.

        Its own mass at its centre, and all beyond at its end, (n_joints, 3).
        """
        links_mm = geometry.links_mm
        centres_mm = np.where(
            np.isnan(self.centres_mm), 0.5 * links_mm, self.centres_mm
        )
        ends_mm = links_mm.copy()
        ends_mm[-1] += geometry.probe_vector_mm
        masses_kg = np.nan_to_num(self.masses_kg)
        hung_kg = np.append(masses_kg[1:], np.nan_to_num(self.probe_mass_kg))
        beyond_kg = np.cumsum(hung_kg[::-1])[::-1]
        return (
            masses_kg[:, np.newaxis] * centres_mm + beyond_kg[:, np.newaxis] * ends_mm
        )


def bodies_from_arm(arm: "Arm") -> Bodies:
    nowhere = (np.nan, np.nan, np.nan)
    centres = [joint.centre_of_mass_mm or nowhere for joint in arm.joints]
    masses = [np.nan if j.mass_kg is None else j.mass_kg for j in arm.joints]
    probe_mass = arm.probe.mass_kg
    return Bodies(
        masses_kg=np.array(masses, dtype=np.float64),
        centres_mm=np.array(centres, dtype=np.float64),
        probe_mass_kg=np.nan if probe_mass is None else probe_mass,
    )


def gravity_moments_nm(
    levers_kg_mm: Floats, gravity_m_s2: Floats, rotations: Floats
) -> Floats:
    """Compute the moments of all weights beyond each joint about its origin.

    Args:
        levers_kg_mm: of all elements, as in `Bodies`, (n_joints, 3).
        gravity_m_s2: (3,).
        rotations: P_1 ... P_n, (4, n_joints, n_samples).

    Returns:
        sum of m (p - o_k) x g in N m, (3, n_joints, n_samples).
    """
    steps_kg_m = M_PER_MM * rotate(rotations, levers_kg_mm.T[:, :, np.newaxis])
    firsts_kg_m = np.cumsum(steps_kg_m[:, ::-1], axis=1)[:, ::-1]
    return cross(firsts_kg_m, gravity_m_s2)
