"""The true arm: drawn deviations from its file, and encoders that count its turns."""

from dataclasses import dataclass

import numpy as np
from pydantic import Field

from traverse.arrays import Floats, Integers
from traverse.kinematics.arm_file.arm import Arm
from traverse.simulator.arm.physics import Mechanism
from traverse.strict_toml.reader import StrictModel


@dataclass(frozen=True, slots=True)
class EncoderSet:
    """The encoders on one board, by channel.

    Attributes:
        joints: (n_channels,) joint on each channel, from 0.
        counts_per_turn: (n_channels,)
        signs: (n_channels,) +1 or -1.
        moduli: (n_channels,) counts at which the encoders wrap.
        noise_rad: standard deviation of a reading.
    """

    joints: Integers
    counts_per_turn: Integers
    signs: Integers
    moduli: Integers
    noise_rad: float

    def counts(self, readings_rad: Floats, noise: np.random.Generator) -> Integers:
        """Quantise readings (n, n_joints) to counts (n, n_channels) below the moduli.

        Noise is drawn row by row, so that cutting a stream into blocks changes nothing.
        """
        seen_rad = readings_rad[:, self.joints]
        if self.noise_rad > 0.0:
            seen_rad = seen_rad + self.noise_rad * noise.standard_normal(seen_rad.shape)
        scale = self.signs * self.counts_per_turn / (2.0 * np.pi)
        return np.rint(seen_rad * scale).astype(np.int64) % self.moduli


class Deviations(StrictModel):
    """Standard deviations of the truth from the arm file."""

    links_mm: float = Field(default=0.0, ge=0.0)
    axes_rad: float = Field(default=0.0, ge=0.0)
    zeros_rad: float = Field(default=0.0, ge=0.0)


@dataclass(frozen=True, slots=True)
class TrueArm:
    """A virtual arm.

    Attributes:
        zeros_rad: (n_joints,) readings in the base posture.
        gearing: (n_joints, n_joints) turns of the hinges by turns of the encoders.
        switching: the probe has a switch.
    """

    mechanism: Mechanism
    zeros_rad: Floats
    gearing: Floats
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
        gearing=gearing_of(arm),
        radius_mm=arm.probe.radius_mm,
        switching=arm.probe.kind == "switching",
    )


def gearing_of(arm: Arm) -> Floats:
    """Return the hinges' turns by the encoders' turns, (n_joints, n_joints)."""
    gearing = np.eye(len(arm.joints))
    for row, joint in zip(gearing, arm.joints, strict=True):
        row[[candidate.name == joint.coupled_to for candidate in arm.joints]] = (
            joint.ratio
        )
    return gearing
