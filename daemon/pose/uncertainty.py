"""The covariance of every point: what the arm, its encoders and the instant leave open.

`traverse.kinematics.uncertainty.point_covariance` has the law. To the readings' own
noise this adds what interpolation may have left of each: m by the motion, which a
steady acceleration makes nearly whole each time, hence m^2; and an instant that may be
off by some time t either way, spread evenly within, hence t^2/3.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from traverse.daemon.config.schema import UncertaintySection
from traverse.daemon.pose.arm_model import ArmModel
from traverse.kinematics.effects.base.block import Block
from traverse.kinematics.uncertainty.point_covariance import (
    PointNoise,
    point_covariances,
)
from traverse.protocol.messages.point import Covariance

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Reading:
    """How the readings of a point came about.

    Attributes:
        block: one sample, with what the effects need.
        speeds_rad_s: of the joints then, (n_joints,); None where not known.
        error_bounds_counts: by interpolation, (n_joints, 2), see
            `Interpolated`; None where all were latched.
        jitter_ns: how far the instant may be off beyond `[uncertainty] trigger_s`.
        samples: how many were averaged.
    """

    block: Block
    speeds_rad_s: Floats | None
    error_bounds_counts: Floats | None = None
    jitter_ns: int = 0
    samples: int = 1


class Uncertainty:
    """States covariances.

    Args:
        settings: standard deviations that no file of the arm tells.
    """

    def __init__(self, settings: UncertaintySection) -> None:
        self._settings = settings
        self._usual: tuple[ArmModel, PointNoise] | None = None

    def covariance(self, model: ArmModel, reading: Reading) -> Covariance | None:
        """xx, xy, xz, yy, yz, zz in mm^2; None where the speed is not known."""
        if reading.speeds_rad_s is None:
            return None
        (found,) = point_covariances(
            model.geometry,
            model.effects,
            reading.block,
            self._noise(model, reading),
            model.covariance,
            speeds_rad_s=reading.speeds_rad_s[np.newaxis],
            samples=reading.samples,
        )
        (xx, xy, xz), (_, yy, yz), (_, _, zz) = found.tolist()
        return xx, xy, xz, yy, yz, zz

    def _noise(self, model: ArmModel, reading: Reading) -> PointNoise:
        """That of a reading; of all that are latched it is the same."""
        if reading.error_bounds_counts is not None or reading.jitter_ns:
            return self._made(model, reading)
        if self._usual is None or self._usual[0] is not model:
            self._usual = model, self._made(model, reading)
        return self._usual[1]

    def _made(self, model: ArmModel, reading: Reading) -> PointNoise:
        settings = self._settings
        per_count_rad = np.abs(model.per_count_rad)
        variances = np.full(len(per_count_rad), settings.encoder_rad**2)
        if reading.error_bounds_counts is not None:
            doubts_rad = reading.error_bounds_counts * per_count_rad[:, np.newaxis]
            variances += doubts_rad[:, 0] ** 2 + doubts_rad[:, 1] ** 2 / 3.0
        return PointNoise(
            np.sqrt(variances),
            per_count_rad,
            settings.contact_mm,
            float(np.hypot(settings.trigger_s, reading.jitter_ns * 1e-9 / np.sqrt(3))),
        )
