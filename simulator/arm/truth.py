"""The arm as it really is: the arm file's values and seeded deviations from them."""

from dataclasses import dataclass

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.arm_file.arm import Arm
from traverse.simulator.arm.physics import Mechanism


@dataclass(frozen=True, slots=True)
class Deviations:
    """Standard deviations of the truth from the arm file."""

    links_mm: float = 0.0
    axes_rad: float = 0.0
    zeros_rad: float = 0.0


@dataclass(frozen=True, slots=True)
class TrueArm:
    """A virtual arm.

    Attributes:
        mechanism: Its base posture.
        zeros_rad: (n_joints,) readings in the base posture.
        radius_mm: Of the probe's ball.
        switching: The probe has a switch.
    """

    mechanism: Mechanism
    zeros_rad: Floats
    radius_mm: float
    switching: bool


def true_arm(arm: Arm, deviations: Deviations, seed: int) -> TrueArm:
    """Draw the true arm; equal seeds give equal arms."""
    rng = np.random.default_rng([seed, 0x7275])
    n_joints = len(arm.joints)
    axes = np.array([joint.axis for joint in arm.joints], dtype=np.float64)
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    tilts = deviations.axes_rad * rng.standard_normal((n_joints, 3))
    axes = axes + np.cross(tilts, axes)
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    links_mm = np.array([joint.link_mm for joint in arm.joints], dtype=np.float64)
    links_mm = links_mm + deviations.links_mm * rng.standard_normal((n_joints, 3))
    zeros_rad = np.array([joint.zero_rad for joint in arm.joints], dtype=np.float64)
    zeros_rad = zeros_rad + deviations.zeros_rad * rng.standard_normal(n_joints)
    ends_mm = np.array(arm.origin_mm, dtype=np.float64) + np.cumsum(links_mm, axis=0)
    origins_mm = np.vstack([np.array(arm.origin_mm, dtype=np.float64), ends_mm[:-1]])
    vector_mm = np.array(arm.probe.vector_mm, dtype=np.float64)
    if arm.probe.direction is None:
        shank = np.array(arm.joints[-1].link_mm) + vector_mm
    else:
        shank = np.array(arm.probe.direction, dtype=np.float64)
    return TrueArm(
        mechanism=Mechanism(
            origins_mm, axes, ends_mm[-1] + vector_mm, shank / np.linalg.norm(shank)
        ),
        zeros_rad=zeros_rad,
        radius_mm=arm.probe.radius_mm,
        switching=arm.probe.kind == "switching",
    )
