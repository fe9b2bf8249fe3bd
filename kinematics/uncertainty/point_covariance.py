"""The covariance of a captured point: its parts and their sum.

C = J (s_e^2 + q^2/12) J^T + A C_p A^T + s_t^2 v v^T + s_c^2 I

with J = dx/dalpha, s_e the noise of an encoder and q its step (a rounded value is
spread evenly over one step, whose variance is q^2/12), A = dx/dp and C_p the covariance
of the identified parameters, s_t the uncertainty of the instant and v = J dalpha/dt the
velocity of the ball, s_c the noise of a contact.

The mean of n samples at rest has 1/n of the encoders' noise, and of that part of the
rounding which noise makes differ between samples; the part that all samples share has
the variance

b = q^2 / (2 pi^2) sum over k of exp(-(2 pi k s_e / q)^2) / k^2,

the Fourier series of the mean rounding error over the place within a step, damped by
the noise: q^2/12 without noise, next to nothing from s_e = q/2 on. A contact, an
instant and the arm itself are the same for all n.

A reading whose correction is held beyond what the arm was seen at is as uncertain, in
addition, as that effect says.

What is left of coarse encoders is spread evenly and not normally: an ellipsoid of 95 %
then holds more than that.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.effects.arm_effects import ArmEffects
from traverse.kinematics.effects.base.block import Block
from traverse.kinematics.effects.pose import corrected_readings
from traverse.kinematics.model.derivatives import probe_derivatives
from traverse.kinematics.model.geometry import Geometry
from traverse.kinematics.uncertainty.arm_covariance import (
    ArmCovariance,
    parameter_columns,
)

_ORDERS = 256  # without noise the rest of the series is 0.2 % of it


@dataclass(frozen=True, slots=True, eq=False)
class PointNoise:
    """Error contributions of every new point.

    Attributes:
        encoder_rad: standard deviations of readings, (n_joints,), or of each point's,
            (n_points, 1, n_joints).
        step_rad: of each encoder: 2 pi / counts_per_turn, (n_joints,).
        contact_mm: standard deviation of a contact, in every direction.
        instant_s: standard deviation of the instant.
    """

    encoder_rad: Floats
    step_rad: Floats
    contact_mm: float
    instant_s: float


@dataclass(frozen=True, slots=True, eq=False)
class PointUncertainties:
    """Uncertainties of the ball's centres.

    Attributes:
        covariances_mm2: of single points, (n_points, 3, 3), symmetric.
        shared_mm: factors S of the arm's parameters: points i and j have the covariance
            S_i S_j^T from them, (n_points, 3, rank).
    """

    covariances_mm2: Floats
    shared_mm: Floats


def point_uncertainties(
    geometry: Geometry,
    effects: ArmEffects,
    block: Block,
    noise: PointNoise,
    arm: ArmCovariance | None = None,
    *,
    speeds_rad_s: Floats | None = None,
    samples: int = 1,
) -> PointUncertainties:
    """Compute the covariances of the ball's centres, and their shared part.

    Args:
        geometry: the arm.
        effects: of the same arm.
        block: the samples with inputs of the effects.
        noise: of one sample.
        arm: covariance of the arm's parameters; None: not included.
        speeds_rad_s: dalpha/dt, (n_points, n_joints); None at rest.
        samples: averaged for each point.
    """
    if arm is None:
        readings_rad = corrected_readings(geometry, effects, block)
        known, by_parameters = probe_derivatives(geometry, readings_rad), None
    else:
        by_parameters, known = parameter_columns(geometry, effects, block)
    n_joints, n_known = geometry.n_joints, 0 if arm is None else arm.factor.shape[1]
    # Readings, the arm, the instant, the contact.
    factor = np.zeros((len(block), 3, n_joints + n_known + 4))
    by_angles = known.by_angles
    stds_rad = _reading_stds(noise, samples)
    for effect in effects.readings:
        if (unseen_rad := effect.unseen_rad(block)) is not None:
            stds_rad = np.broadcast_to(stds_rad, (len(block), 1, n_joints)).copy()
            joints = stds_rad[:, 0, effect.joints]
            joints[:] = np.hypot(joints, unseen_rad[:, np.newaxis])
    np.multiply(by_angles, stds_rad, out=factor[:, :, :n_joints])
    if arm is not None and by_parameters is not None:
        factor[:, :, n_joints:-4] = by_parameters @ arm.factor
    if speeds_rad_s is not None:
        velocity = by_angles @ speeds_rad_s[:, :, np.newaxis]
        factor[:, :, -4:-3] = noise.instant_s * velocity
    for component in range(3):
        factor[:, component, component - 3] = noise.contact_mm
    covariances: Floats = factor @ factor.transpose(0, 2, 1)
    return PointUncertainties(covariances, factor[:, :, n_joints:-4])


@lru_cache(maxsize=8)  # noise is never changed, and that of most points is the same
def _reading_stds(noise: PointNoise, samples: int) -> Floats:
    return np.sqrt(reading_variances(noise, samples))


def reading_variances(noise: PointNoise, samples: int = 1) -> Floats:
    """Compute variances of the mean of samples of each encoder at rest.

    Returns:
        rad^2, (n_joints,).
    """
    single = noise.encoder_rad**2 + noise.step_rad**2 / 12.0
    if samples == 1:
        return single
    orders = np.arange(1, _ORDERS + 1)[:, np.newaxis]
    steps = np.where(noise.step_rad > 0.0, noise.step_rad, 1.0)
    damping = np.exp(-((2.0 * np.pi * orders * noise.encoder_rad / steps) ** 2))
    shared = noise.step_rad**2 / (2.0 * np.pi**2) * np.sum(damping / orders**2, axis=0)
    variances: Floats = shared + (single - shared) / samples
    return variances
