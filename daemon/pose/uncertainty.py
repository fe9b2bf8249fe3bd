"""Error bounds of poses and covariances of points.

Joints are read at different instants. With m_j and t_j the errors of joint j by its
motion and by its instant (`traverse.daemon.acquisition.interpolation`), as angles, and
l_j = |dx/dalpha_j| for the ball,

error = sum over j of l_j m_j + root of the sum over j of (l_j t_j)^2

Errors by motion add up: a hand accelerates all joints at once. Errors of instants are
independent.

`traverse.kinematics.uncertainty.point_covariance` has the covariance that arm, encoders
and instant leave. To the readings' own noise this module adds errors of interpolation:
m by the motion, which a steady acceleration makes nearly whole each time, hence m^2;
and instants that may be off by t either way, evenly distributed, hence t^2/3. In the
time by which the instant of all joints may be off, the speed changes, too.
"""

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from traverse.arrays import Floats
from traverse.daemon.config.schema import UncertaintySection
from traverse.daemon.pose.arm_model import ArmModel
from traverse.daemon.pose.poses import LatchedPose, PoseBlock
from traverse.kinematics.effects.base.block import Block
from traverse.kinematics.model.derivatives import probe_derivatives
from traverse.kinematics.uncertainty.point_covariance import (
    PointNoise,
    PointUncertainties,
    point_uncertainties,
)
from traverse.protocol.messages import REMARKS, QualityFlag
from traverse.protocol.messages.point import Covariance

HAND_RAD_S2 = 5.0  # as a joint led by hand accelerates; twice that is rare
MOST_JITTER_NS = 100_000_000  # from here on there is no covariance, but a flag
UPPER = np.triu_indices(3)  # places of xx, xy, xz, yy, yz, zz in a covariance


def is_only_skewed(quality: int) -> bool:
    """Return whether a pose is in doubt for the instants of its joints alone."""
    return quality & ~REMARKS.value == QualityFlag.SKEW.value


class SkewMonitor:
    """Flags poses with large error bounds, and keeps the largest.

    Args:
        limit_mm: a larger one is flagged ``skew``.
    """

    def __init__(self, limit_mm: float) -> None:
        self._limit_mm = limit_mm
        self._largest_mm: float | None = None

    def pop_largest_mm(self) -> float | None:
        """Return the largest error since the last call, or None."""
        largest_mm, self._largest_mm = self._largest_mm, None
        return largest_mm

    def flag_block(
        self, model: ArmModel, poses: PoseBlock, error_bounds_counts: Floats
    ) -> None:
        """Flag poses by error bounds (n, n_joints, 2) of their counts."""
        # The levers of the last pose do for a block: it spans milliseconds.
        errors_mm = _errors_mm(
            error_bounds_counts, _levers_mm(model, poses.angles_rad[-1])
        )
        self._record(float(errors_mm.max()))
        poses.quality[errors_mm > self._limit_mm] |= np.uint32(QualityFlag.SKEW)

    def with_flags(self, model: ArmModel, pose: LatchedPose) -> LatchedPose:
        """Flag a pose by the error bounds of its counts."""
        if pose.error_bounds_counts is None:
            return pose
        levers_mm = _levers_mm(model, pose.angles_rad)
        bounds_counts = pose.error_bounds_counts[np.newaxis]
        error_mm = float(_errors_mm(bounds_counts, levers_mm)[0])
        self._record(error_mm)
        if error_mm <= self._limit_mm:
            return pose
        return replace(pose, quality=pose.quality | QualityFlag.SKEW.value)

    def _record(self, error_mm: float) -> None:
        self._largest_mm = max(self._largest_mm or 0.0, error_mm)


def _errors_mm(error_bounds_counts: Floats, levers_mm: Floats) -> Floats:
    """Compute errors (n,) of error bounds (n, n_joints, 2)."""
    by_motion = error_bounds_counts[:, :, 0] @ levers_mm
    by_instants = error_bounds_counts[:, :, 1] ** 2 @ levers_mm**2
    return np.asarray(by_motion + np.sqrt(by_instants))


def _levers_mm(model: ArmModel, angles_rad: Floats) -> Floats:
    """Compute the motion of the ball by a count of each joint, (n_joints,)."""
    derivatives = probe_derivatives(model.geometry, angles_rad[np.newaxis])
    levers_mm = np.linalg.norm(derivatives.by_angles[0], axis=0)
    return np.asarray(levers_mm * np.abs(model.per_count_rad))


@dataclass(frozen=True, slots=True, eq=False)
class CovarianceInput:
    """How the readings of points were obtained.

    Attributes:
        block: n samples, with the inputs of effects.
        speeds_rad_s: of the joints, (n, n_joints); NaN where unknown.
        error_bounds_counts: by interpolation, (n, n_joints, 2), see `Interpolated`;
            None if all were latched.
        jitter_ns: for how long the ball may have moved between the instants and the
            readings, beyond `[uncertainty] trigger_s`.
        samples: averaged for the one point.
    """

    block: Block
    speeds_rad_s: Floats
    error_bounds_counts: Floats | None = None
    jitter_ns: int = 0
    samples: int = 1


@dataclass(frozen=True, slots=True, eq=False)
class StatedCovariance:
    """Uncertainty of one point; None if speed or geometry is unknown.

    Attributes:
        own_mm2: xx, xy, xz, yy, yz, zz.
        shared_mm: see `PointUncertainties`, (3, rank); a view of a larger array.
    """

    own_mm2: Covariance | None
    shared_mm: Floats | None


class CountSteps(Protocol):
    """By how many counts the readings of joints differ at least.

    Attributes:
        steps_counts: (n_joints,), at least 1. Another array after a change.
    """

    steps_counts: Floats


class CovarianceEvaluator:
    """Computes covariances of ball centres.

    Args:
        settings: standard deviations that no file of the arm states.
        steps: of counts; None: readings differ by one.
    """

    def __init__(
        self, settings: UncertaintySection, steps: CountSteps | None = None
    ) -> None:
        self._settings, self._steps = settings, steps
        self._cached: tuple[ArmModel, Floats | None, PointNoise] | None = None

    def covariance(self, model: ArmModel, reading: CovarianceInput) -> StatedCovariance:
        """Compute that of one sample, and its part by the arm's parameters."""
        stated = self._uncertainties(model, reading)
        if stated is None or np.isnan(reading.speeds_rad_s).any():
            return StatedCovariance(None, None)
        (xx, xy, xz), (_, yy, yz), (_, _, zz) = stated.covariances_mm2[0].tolist()
        return StatedCovariance((xx, xy, xz, yy, yz, zz), stated.shared_mm[0])

    def covariances_mm2(self, model: ArmModel, reading: CovarianceInput) -> Floats:
        """Compute covariances of samples, (n, 6) as `Covariance`; NaN if unknown."""
        stated = self._uncertainties(model, reading)
        if stated is None:
            return np.full((len(reading.block), len(UPPER[0])), np.nan)
        return stated.covariances_mm2[:, *UPPER]

    def _uncertainties(
        self, model: ArmModel, reading: CovarianceInput
    ) -> PointUncertainties | None:
        """Compute uncertainties; None while the largest part is not known."""
        if model.geometry_doubt or reading.jitter_ns >= MOST_JITTER_NS:
            return None
        return point_uncertainties(
            model.geometry,
            model.effects,
            reading.block,
            self._noise(model, reading),
            model.covariance,
            speeds_rad_s=reading.speeds_rad_s,
            samples=reading.samples,
        )

    def _noise(self, model: ArmModel, reading: CovarianceInput) -> PointNoise:
        """Return the noise of a reading, which is constant for latched ones."""
        if reading.error_bounds_counts is not None or reading.jitter_ns:
            return self._evaluate(model, reading)
        steps_counts, cached = self._steps_counts, self._cached
        if cached is None or cached[0] is not model or cached[1] is not steps_counts:
            cached = model, steps_counts, self._evaluate(model, reading)
            self._cached = cached
        return cached[2]

    @property
    def _steps_counts(self) -> Floats | None:
        return None if self._steps is None else self._steps.steps_counts

    def _evaluate(self, model: ArmModel, reading: CovarianceInput) -> PointNoise:
        settings = self._settings
        per_count_rad = np.abs(model.per_count_rad)
        steps_counts = self._steps_counts
        step_rad = (
            per_count_rad if steps_counts is None else per_count_rad * steps_counts
        )
        variances = np.full(len(per_count_rad), settings.encoder_rad**2)
        if reading.error_bounds_counts is not None:
            bounds_rad = reading.error_bounds_counts * per_count_rad[:, np.newaxis]
            by_bounds = bounds_rad[..., 0] ** 2 + bounds_rad[..., 1] ** 2 / 3.0
            variances = (variances + by_bounds)[:, np.newaxis]
        jitter_s = reading.jitter_ns * 1e-9
        variances += (HAND_RAD_S2 * jitter_s**2 / 2.0) ** 2 / 3.0
        return PointNoise(
            np.sqrt(variances),
            step_rad,
            settings.contact_mm,
            float(np.hypot(settings.trigger_s, jitter_s / np.sqrt(3.0))),
        )
